"""What is asked of lanes beyond a sweep: the worst of them, and what matters."""
