"""Results without simulation: certificates, bounds and the exact solution.

This folder depends on `jaxnet.model` alone.
"""
