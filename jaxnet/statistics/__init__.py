"""What lanes say: summaries, shares that did not recover, fits, and lanes held against bounds."""
