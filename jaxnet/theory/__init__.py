"""What is known without simulating: the certificate of a scenario, and the exact solution. Rests on model."""
