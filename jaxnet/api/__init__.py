"""The Python interface: `results` and `studies` for scripts, `writing` for the command line."""
