"""Results without simulation: certificates, bounds, exact solutions; needs `jaxnet.model` alone."""
