"""The results folder: who may write, what is in it, and reading it back as `Results`."""
