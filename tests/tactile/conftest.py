"""The library of contacts that taps are drawn from."""

import pytest

from bgmodel.tactile.library import contact_library
from tests.tactile.plans import PLAN


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BGMODEL_CACHE", str(tmp_path_factory.mktemp("cache")))
        return contact_library(PLAN)
