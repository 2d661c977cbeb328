"""The version of jaxnet. Every room may import it, and none has to import the package's root."""

__version__ = "0.1.0"
