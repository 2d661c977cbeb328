"""Problems whose answer is known, as batches of lanes that the engines can run."""

from typing import Any

import jax
import numpy as np
import yaml

from jaxnet.engine import batch
from jaxnet.engine.batch import Job
from jaxnet.engine.chassis import Outcome
from jaxnet.study import sweep
from jaxnet.study.api import Study
from jaxnet.study.document import Document
from jaxnet.study.lanes import job


def study(**keys: Any) -> Study:
    """A study of these keys, the defaults elsewhere."""
    return Study(
        *sweep.read(Document(yaml.safe_dump({"name": "test", **keys}, sort_keys=False), "test.yaml"))
    )


def lanes(given: Study, samples: int, save: tuple[str, ...] = ("state",)) -> Job:
    """Lanes of all cells of a study, cell by cell; the cells must share a compiled program."""
    return batch.join([job(cell.scenario, given.config.seed, range(samples), save) for cell in given.cells])


def simulate(one: Job) -> Outcome:
    """Outcomes of a job."""
    return batch.simulate(one)


def lane(one: Job, number: int) -> Any:
    """One lane of a job, by itself."""
    return jax.tree.map(lambda leaf: np.asarray(leaf[number]), one.inputs.lane)
