"""A study of two cells for the tests of this folder."""

STUDY = {
    "name": "small",
    "samples": 2,
    "horizon": 1.0,
    "tail": 0.5,
    "topology": "star",
    "engine": "exact",
    "defence": "none",
    "sweep": {"attack.magnitude": [1, 5.5]},
}
