"""The results folder: its lock, its files, and `Results`, which reads them."""
