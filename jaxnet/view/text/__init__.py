"""Text for a terminal: tables, the report of `check`, progress."""
