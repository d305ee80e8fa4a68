"""The page behind its token in a real browser, with the cookies that it keeps."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="viser is not installed")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rostest"))
from support import browser
from web_clients import opened

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(browser.missing()), reason=browser.missing()),
]


def test_who_brought_the_token_once_is_let_in():
    with opened(host="0.0.0.0") as server, browser.Browser() as chromium:
        switch = server.viser.gui.add_checkbox("Frames", False)
        address, _, token = server.address.partition("?token=")
        page = chromium.open(address, (480, 420), script=browser.JAGGED)
        assert "needs the token" in page.text()
        assert token not in page.raw.content()
        for place in (server.address, address):
            page.raw.goto(place)
            page.wait_for(lambda: "Frames" in page.text(), "the page")
        page.dismiss()
        page.check("Frames")
        page.wait_for(lambda: switch.value, "the person's click")
        page.close()
