"""Where results go, and which study a search simulates."""

import uuid
from pathlib import Path

from upath import UPath

from jaxnet.config.document import ConfigError, Problem
from jaxnet.config.study import Study, StudySource, load
from jaxnet.store.folder import Folder

AnyPath = str | Path | UPath


def default_out(study: Study, out: AnyPath | None) -> AnyPath:
    """Return the results folder of a study: the given one, or results/NAME."""
    return Path("results") / study.config.name if out is None else out


def in_memory() -> Folder:
    return Folder(f"memory://jaxnet/{uuid.uuid4().hex}")


def with_random_lanes(study: StudySource) -> Study:
    """Return a study with as many random lanes as its search takes; raise ConfigError."""
    study = load(study)
    if study.config.search is None:
        told = "is missing: search: {over: {attack.phase: each}}"
        raise ConfigError([Problem(study.config.name, "search", told)])
    return load(study, {"samples": study.config.search.budget})
