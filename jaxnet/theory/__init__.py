"""Results without simulation: theorems with their premises, bounds, exact solutions."""
