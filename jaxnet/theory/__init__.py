"""What is known without simulating: certificate, bounds and exact solution. Rests on model."""
