"""From a YAML file to the cells of a study.

`document` has text with places, `keys` the keys, `cells` the sweep, `faults` what cannot be
simulated; `study` joins them.
"""
