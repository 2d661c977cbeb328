"""A run: shards of lanes are simulated here or by workers until the folder has all lanes."""
