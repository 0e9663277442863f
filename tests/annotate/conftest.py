"""The tiny model, written once a machine and loaded once a session:
importing torch takes seconds.
"""

from pathlib import Path

import pytest

from kb.core.config.settings import load_settings
from kb.sandbox.toxicity import tiny_checkpoint
from kb.store.checkpoint import Checkpoint, find_checkpoint
from tests.conftest import needs


@pytest.fixture(scope="session")
def tiny() -> Path:
    needs("torch", "detoxify")
    return tiny_checkpoint()


@pytest.fixture(scope="session")
def checkpoint(tiny: Path) -> Checkpoint:
    return find_checkpoint(load_settings(dotenv=False, kb_toxicity_model=str(tiny)))


@pytest.fixture(scope="session")
def detoxify(checkpoint: Checkpoint):
    from kb.annotate.detoxify_model import load_detoxify

    return load_detoxify(checkpoint)


@pytest.fixture
def make_run(tmp_path: Path, tiny: Path):
    """A Run over an own data root with the tiny model; options as keywords."""
    from kb.core.config.profile import load_profile
    from kb.core.context import Run

    def make(**options):
        settings = load_settings(dotenv=False, kb_toxicity_model=options.pop("model", str(tiny)))
        profile = load_profile("minecraft")
        if "thresholds" in options:
            toxicity = profile.toxicity.model_copy(
                update={
                    "thresholds": profile.toxicity.thresholds.model_copy(
                        update=options.pop("thresholds")
                    )
                }
            )
            profile = profile.model_copy(update={"toxicity": toxicity})
        return Run(
            settings=settings,
            profile=profile,
            root=options.pop("root", tmp_path / "data"),
            **{"workers": 1, **options},
        )

    return make
