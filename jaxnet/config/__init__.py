"""From a YAML file to the cells of a study.

- `document` reads text and the places of its keys
- `keys` defines the keys of a config
- `cells` spans the sweep
- `faults` refuses scenarios that cannot be simulated
- `wording` puts errors in a user's words
- `study` joins these steps
"""
