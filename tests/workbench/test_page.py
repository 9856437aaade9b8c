"""Facts of the page in a browser: what a mouse and sliders do, what is saved, what stays said, and
that nothing grows. `make workbench` runs them, with Panel, Playwright and a Chromium.
"""

import json
from http.client import HTTPConnection

import pytest

from eval.visit import TEXT, VALUES, visit
from irs_gym import load_scene

pytestmark = pytest.mark.needs("panel", "playwright")
DRAGS = 100
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Protocol": "bokeh, token",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="module")
def opened(folder):
    with visit(folder) as found:
        yield found


@pytest.fixture
def page(opened):
    """A page as it is when it is first seen, whose browser has nothing to complain of at the end."""
    opened.load()
    yield opened
    assert opened.complaints == []


def field(page, label):
    return page.page.get_by_label(label, exact=True)


def save_as(page, name):
    field(page, "Save as").fill(name)
    field(page, "Save as").press("Tab")
    page.page.get_by_role("button", name="Save", exact=True).click()


def says(page, text):
    page.page.wait_for_function(f"({TEXT})().includes({json.dumps(text)})")


def holds(page, label, value):
    """Wait until a field holds a value."""
    page.page.wait_for_function(
        f"([label, value]) => ({VALUES})()[label] === value", arg=[label, value]
    )


def test_dragging_an_obstacle_moves_it_and_all_that_follows(page):
    page.drag((0.0, 0.0), (0.0, -2.0))
    holds(page, "y (m)", -2.0)
    says(page, "shortest path 20.328 m")


@pytest.mark.parametrize(
    ("begin", "end", "numbers"),
    [
        ((-10.0, 0.0), (-8.0, 2.0), {"x (m)": -8.0, "y (m)": 2.0}),  # start
        ((10.0, 0.0), (9.0, -1.0), {"x (m)": 9.0, "y (m)": -1.0}),  # goal
        ((0.0, 10.0), (3.0, 9.0), {"x (m)": 3.0, "y (m)": 9.0, "z (m)": 2.0}),  # access point
        ((0.0, -10.0), (9.5, -2.0), {"y (m)": -2.0, "z (m)": 2.0}),  # panel, to another wall
    ],
)
def test_ends_access_points_and_panels_can_be_dragged(page, begin, end, numbers):
    before = page.text()
    page.drag(begin, end)
    for label, number in numbers.items():
        holds(page, label, number)
    assert page.text() != before


def test_a_bad_placement_is_said_at_the_part_and_the_last_good_one_stays(page):
    page.drag((-10.0, 0.0), (-8.0, 0.0))
    page.drag((-8.0, 0.0), (0.0, 0.5))
    says(page, "start=(0.0, 0.5) lies inside an obstacle")
    holds(page, "x (m)", -4.0)  # the point between
    assert "Traceback" not in page.text()


def test_a_number_typed_in_that_cannot_be_goes_back(page):
    page.page.mouse.click(*page.pixel((0.0, 0.0)))
    page.settle()
    height = field(page, "height (m)")
    height.fill("9")
    height.press("Tab")
    says(page, "obstacles[2] reaches from")
    holds(page, "height (m)", 1.3)


def test_sliders_move_the_target_the_elements_and_the_bits(page):
    handles = page.page.locator(".noUi-handle")
    target = handles.nth(0)
    target.focus()
    for _ in range(3):
        target.press("ArrowRight")
    says(page, "shortest path 24.056 m")
    elements = handles.nth(1)
    elements.focus()
    elements.press("Home")
    says(page, "none at -61.50 dB")
    elements.press("End")
    holds(page, "Elements on each panel", 4800)
    says(page, "shortest path 21.571 m")
    bits = handles.nth(2)
    bits.focus()
    bits.press("Home")
    says(page, "Phase bits: 1")


def test_a_scene_is_saved_not_overwritten_and_there_again_after_a_reload(page, folder):
    page.drag((0.0, 0.0), (0.0, -2.0))
    save_as(page, "hall")
    says(page, "Saved as hall.json.")
    says(page, f"python -m train ppo --env.scene {folder / 'hall.json'} --out runs/hall-ppo")
    saved = load_scene(folder / "hall.json")
    assert saved.obstacles[2].center == (0.0, -2.0)

    page.load()
    save_as(page, "hall")
    says(page, "hall.json is there already: tick the box to replace it")
    assert load_scene(folder / "hall.json") == saved

    field(page, "Open").select_option(label="hall")
    page.page.get_by_role("button", name="Open", exact=True).click()
    says(page, "shortest path 20.328 m")


@pytest.mark.parametrize("name", ["../out", "/tmp/out", ".."])
def test_no_name_leads_out_of_the_folder(page, folder, name):
    before = sorted(folder.parent.rglob("*"))
    save_as(page, name)
    says(page, f"name='{name}' must be made of letters, digits, '_', '-' and '.'")
    assert sorted(folder.parent.rglob("*")) == before


@pytest.mark.parametrize("name", ["workshop", "ward", "warehouse"])
def test_every_scene_of_the_package_is_drawn_to_scale(page, name):
    field(page, "Open").select_option(label=name)
    page.page.get_by_role("button", name="Open", exact=True).click()
    holds(page, "Save as", name)
    room = load_scene(name).room
    (left, bottom), (right, top) = page.pixel(room.lower), page.pixel(room.upper)
    sides = (right - left) / (bottom - top)
    assert sides == pytest.approx((room.x_max - room.x_min) / (room.y_max - room.y_min), rel=0.02)
    assert max(right - left, bottom - top) > 500


def test_policies_go_beside_the_oracle(page):
    for name in ("explorer", "planner"):
        page.page.get_by_label(name, exact=True).check()
    says(page, "planner: 23.228 m, +0.0 %")
    page.page.wait_for_function(f"!({TEXT})().includes('...')")
    assert "explorer: " in page.text()


def test_two_visitors_do_not_see_each_others_scene(page):
    other = page.page.context.browser.new_page()
    other.goto(page.url)
    other.wait_for_function("window.Bokeh?.documents[0]?.is_idle")
    page.drag((0.0, 0.0), (0.0, -2.0))
    says(page, "shortest path 20.328 m")
    assert "shortest path 23.228 m" in other.evaluate(f"({TEXT})()")
    other.close()


def test_a_page_of_another_site_may_not_talk_to_it(page):
    host = page.url.removeprefix("http://")
    answers = {}
    for origin in ("http://evil.example", f"http://{host}"):
        connection = HTTPConnection(host)
        connection.request("GET", "/ws", headers={**UPGRADE, "Origin": origin})
        answers[origin] = connection.getresponse().status
        connection.close()
    assert answers["http://evil.example"] == 403
    assert answers[f"http://{host}"] != 403


def test_a_hundred_drags_leave_no_models_and_no_memory_behind(page):
    def drag_to_and_fro(times):
        page.take((0.0, 0.0))
        for n in range(times):
            page.move((0.25 * (n % 5), -0.25 * (n % 7)))
        page.move((0.0, 0.0))
        page.drop()

    drag_to_and_fro(10)  # whatever is made once, is there
    models = page.models()
    memory = page.memory()
    drag_to_and_fro(DRAGS)
    assert page.models() == models
    assert page.memory() < memory + 8 * 2**20  # of 130 MiB: arrays of the last map
