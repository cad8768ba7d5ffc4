"""What several tests share: a seeded generator, and the published plans where they lie beside the checkout."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# No window system in tests, whatever the user's own matplotlib settings are; children of the tests inherit it.
os.environ["MPLBACKEND"] = "Agg"

# Nor the user's own cache: set here, since test modules load plans while they are imported.
os.environ["GALOC_CACHE"] = tempfile.mkdtemp(prefix="galoc-test-cache-")
os.environ.pop("GALOC_CACHE_GB", None)
atexit.register(shutil.rmtree, os.environ["GALOC_CACHE"], ignore_errors=True)

# The same examples in every run, and no deadline: on shared cores a slow example says nothing about the code.
settings.register_profile("galoc", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("galoc")

REPO = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repo() -> Path:
    """Root of the checkout."""
    return REPO


@pytest.fixture(scope="session")
def shared_plans() -> Path:
    """Folder of published plans (not part of the checkout); the test is skipped where it is absent."""
    folder = REPO.parent / "shared" / "data" / "plans"
    if not folder.is_dir():
        pytest.skip("published plans are not on this machine (looked for shared/data/plans beside the checkout)")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(20240607)
