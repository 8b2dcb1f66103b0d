"""The library of contacts that taps are drawn from."""

import pytest

from bgmodel.tactile.library import contact_library
from tests.tactile.plans import PLAN


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return contact_library(PLAN, cache_dir=tmp_path_factory.mktemp("cache"))
