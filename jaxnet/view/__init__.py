"""What people look at: tables, the check's text, progress, figures."""
