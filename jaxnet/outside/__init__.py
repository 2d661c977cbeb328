"""Code from outside: modules beside a config or installed, what they are made of, and who is to blame."""
