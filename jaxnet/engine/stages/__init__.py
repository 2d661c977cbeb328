"""The stages of a tick, a file each. The base class of a stage is a stage that is off."""
