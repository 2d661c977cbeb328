"""A run: draws make lanes, lanes make shards, shards are simulated here or by workers until all are there."""
