"""From YAML to cells.

`document` reads text with places, `keys` says what it may hold, `cells` spans the sweep, `faults` refuses
what cannot be simulated, `wording` says so in words for users, `study` is the whole.
"""
