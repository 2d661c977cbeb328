"""Code from outside: modules beside a config or installed, their contents, their errors."""
