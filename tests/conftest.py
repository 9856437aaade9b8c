"""What all tests share: a key of their own, so that none is made among the settings of whoever runs them."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def _own_key(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IRS_GYM_KEY", str(tmp_path_factory.mktemp("key") / "key"))
        yield
