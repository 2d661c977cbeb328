"""What a terminal shows: tables, the report of `check`, progress."""
