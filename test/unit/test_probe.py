"""The benchmark sees when a page in a real browser has drawn a change."""

import time

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")
viser = pytest.importorskip("viser", reason="viser is not installed")
chromium = pytest.importorskip("bench.chromium")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(chromium.missing()), reason=chromium.missing()),
]
WINDOW = (640, 480)


@pytest.fixture(scope="module")
def server():
    """A page with a box and a slider."""
    made = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    made.scene.configure_environment_map(None)
    made.initial_camera.position = (3.0, 3.0, 2.0)
    yield made
    made.stop()


def test_a_change_is_seen_after_it_was_made(server):
    box = server.scene.add_box("/box", (200, 0, 0), (1.0, 1.0, 1.0))
    slider = server.gui.add_slider("joint", -2.0, 2.0, 0.001, 0.0)
    address = f"http://127.0.0.1:{server.get_port()}"
    with chromium.Browser() as browser:
        page = chromium.WatchedPage(browser, address, WINDOW)
        thumb = page.page.element("joint").get_by_role("slider")
        thumb.evaluate("thumb => g1probe.watch(thumb)")
        page.rest()
        assert page.ask(f"g1probe.changed({chromium.AT_ONCE})") is None
        assert page.ask("g1probe.turned(1.0, 0.002)") is None
        begin = time.monotonic()
        box.position, slider.value = (1.0, 0.0, 0.0), 1.0
        scene = page.time_of(f"g1probe.changed({chromium.AT_ONCE})")
        turned = page.time_of("g1probe.turned(1.0, 0.002)")
        end = time.monotonic()
        begin, end = begin - page.clock_error, end + page.clock_error
        assert begin < scene < end and begin < turned < end


def test_the_first_picture_with_all_of_a_thing_is_found(server):
    server.scene.reset()
    address = f"http://127.0.0.1:{server.get_port()}"
    with chromium.Browser() as browser:
        page = chromium.WatchedPage(browser, address, WINDOW)
        page.rest()
        page.ask("g1probe.keep('empty')")
        before = time.monotonic()
        box = server.scene.add_box("/box", (200, 0, 0), (1.0, 1.0, 1.0))
        page.time_of(f"g1probe.changed({chromium.AT_ONCE})")
        page.rest()
        page.ask("g1probe.keep('whole')")
        after = time.monotonic()
        box.remove()
        seen, pixels = page.ask("g1probe.seen('whole', 'empty')")
        assert pixels > chromium.AT_ONCE
        assert seen is not None and before < page.at(seen) < after
