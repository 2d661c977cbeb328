"""Batches of lanes from a cell of a study and its samples: draws, proofs and jobs for engines."""
