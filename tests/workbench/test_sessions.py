"""Facts of visits to the workbench, seen from the server; `make workbench` runs them."""

import gc
import time
import weakref
from contextlib import suppress

import pytest

from irs_gym import load_scene
from irs_gym.workbench.__main__ import free_port
from irs_gym.workbench.scene_folder import SceneFolder

pytestmark = pytest.mark.needs("panel")


def test_a_page_that_was_left_is_forgotten(tmp_path):
    import panel
    from bokeh.client import pull_session

    from irs_gym.workbench.page import Page

    made = []

    def visited():
        page = Page(load_scene("paper"), SceneFolder(tmp_path))
        made.append(weakref.ref(page))
        return page.layout

    port = free_port("127.0.0.1")
    server = panel.serve(
        visited,
        address="127.0.0.1",
        port=port,
        websocket_origin=[f"127.0.0.1:{port}"],
        show=False,
        verbose=False,
        threaded=True,
        check_unused_sessions_milliseconds=100,
        unused_session_lifetime_milliseconds=100,
    )
    begun = time.monotonic()
    try:
        while len(made) < 3 and time.monotonic() < begun + 60:
            with suppress(OSError):  # until the server is there
                pull_session(url=f"http://127.0.0.1:{port}/").close()
        while any(each() for each in made) and time.monotonic() < begun + 120:
            time.sleep(0.2)
            gc.collect()
    finally:
        server.stop()

    assert [each() for each in made] == [None, None, None]
