"""Studies beyond a sweep: the worst choice, rare failures and sensitivity indices."""
