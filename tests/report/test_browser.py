"""The report as a browser shows it: its own data first, then what is on the screen."""

import html
import json
import os
import shutil
import subprocess
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from made_up_desk import MadeUpMap, make_desk

from seo_slam.records import Trajectory
from seo_slam.report.html import write_report

WIDTHS = {"desktop": 1200, "phone": 360}
DARK = "--blink-settings=preferredColorScheme=0"


class Dom(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.root, self.data, self.rows, self.labels_in_order = {}, "", [], []
        self._inside = None
        self.shown_details = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag == "html":
            self.root = attributes
        elif tag == "script":
            self._inside = attributes.get("id")
        elif tag == "tr" and "data-id" in attributes:
            self.rows.append(attributes)
        elif attributes.get("id") == "details":
            self.shown_details = "hidden" not in attributes

    def handle_endtag(self, tag):
        self._inside = None

    def handle_data(self, data):
        if self._inside == "report-data":
            self.data += data


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    """Runs a browser on a page: ``chromium(page, width, *flags)`` returns what it prints."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        message = "needs a browser: none of chromium, chromium-browser, google-chrome is on the PATH"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)

    def run(address: str, width: int, *flags: str, height: int = 1600) -> str:
        command = [found, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"]
        command += ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"]
        command += [f"--user-data-dir={tmp_path_factory.mktemp('profile')}", f"--window-size={width},{height}", *flags, address]
        done = subprocess.run(command, capture_output=True, timeout=180, check=True)
        return done.stdout.decode("utf-8")

    return run


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A report of a made-up desk, and the desk."""
    desk = make_desk(14, labels=("book", "cup", "keyboard", "tv", "<b>mouse</b>"))
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, **desk.arguments)
    return path, desk


def picture(chromium, path, target, width, *flags):
    chromium(path.as_uri(), width, f"--screenshot={target}", *flags)
    image = cv2.imread(str(target))
    assert image is not None
    assert image.shape[1] == width
    return image


def assert_not_blank(image):
    assert image.std() > 10
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 500


def framed(path, width, target):
    """A page with the report in a frame of this width, since a window is never narrower than 500; it copies what the report says.

    In it stand the report's own data and the attributes that the report sets on its root.
    """
    inner = html.escape(path.read_text(encoding="utf-8"), quote=True)
    copy = """
        const inner = document.querySelector("iframe").contentDocument;
        Object.assign(document.documentElement.dataset, inner.documentElement.dataset);
        document.documentElement.dataset.map = inner.querySelector(".map-narrow").getBoundingClientRect().width;
        document.body.append(inner.getElementById("report-data").cloneNode(true));
    """
    frame = f'<iframe srcdoc="{inner}" style="width: {width}px; height: 800px; border: 0"></iframe>'
    target.write_text(f"<!doctype html><body>{frame}<script>onload = () => {{{copy}}}</script>", encoding="utf-8")
    return target


def without_map(path, target):
    """The same page with the drawing in the map's frame painted over by nothing: what a map that fails to draw looks like."""
    text = path.read_text(encoding="utf-8")
    target.write_text(text.replace("</style>", ".map > g { display: none }</style>"), encoding="utf-8")
    return target


@pytest.mark.parametrize("width", [*WIDTHS.values(), 768, 1061])
def test_the_page_holds_its_data_and_fits_the_screen(chromium, report, tmp_path, width):
    path, desk = report
    dom = Dom(chromium(framed(path, width, tmp_path / "framed.html").as_uri(), 1400, "--dump-dom"))
    data = json.loads(dom.data)
    assert [m["id"] for m in data["landmarks"]] == [m.id for m in desk.map.landmarks]
    assert {m["label"] for m in data["landmarks"]} == {m.label for m in desk.map.landmarks}
    assert dom.root["data-viewport"] == str(width)
    assert dom.root["data-overflow"] == "false"
    assert (float(dom.root["data-map"]) > 280) == (width == WIDTHS["phone"])  # the narrow map is for phones only


@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS.keys())
def test_the_picture_is_not_blank_and_the_map_is_drawn(chromium, report, tmp_path, width):
    path, _ = report
    image = picture(chromium, path, tmp_path / "page.png", width)
    assert_not_blank(image)
    assert np.median(image) > 200
    bare = picture(chromium, without_map(path, tmp_path / "bare.html"), tmp_path / "bare.png", width)
    drawn = np.abs(image.astype(int) - bare).max(axis=2) > 8
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    assert np.ptp(columns) > 0.6 * width
    assert np.ptp(rows) > 0.35 * width
    area = image[rows[0] : rows[-1], columns[0] : columns[-1]].reshape(-1, 3)
    assert area.std() > 5
    assert len(np.unique(area, axis=0)) > 100
    assert drawn.mean() > 0.01


@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS.keys())
def test_it_is_dark_where_dark_is_wished(chromium, report, tmp_path, width):
    image = picture(chromium, report[0], tmp_path / "page.png", width, DARK)
    assert_not_blank(image)
    assert np.median(image) < 80


def test_a_touched_landmark_shows_its_details_and_a_click_sorts(chromium, report, tmp_path):
    path, desk = report
    page = path.read_text(encoding="utf-8")
    play = "document.querySelector('.map-wide a.landmark').dispatchEvent(new MouseEvent('click', {bubbles: true, cancelable: true}));"
    play += "document.querySelector('#table-stable th[data-key=observations]').click();"
    page = page.replace("script-src 'sha256-", "script-src 'unsafe-inline' 'none").replace("</body>", f"<script>{play}</script></body>")
    page = page[: page.index("script-src 'unsafe")] + "script-src 'unsafe-inline'" + page[page.index("; base-uri") :]
    played = tmp_path / "played.html"
    played.write_text(page, encoding="utf-8")
    assert not Dom(chromium(path.as_uri(), 1200, "--dump-dom")).shown_details
    dom = Dom(chromium(played.as_uri(), 1200, "--dump-dom"))
    assert dom.shown_details
    seen = [int(row["data-observations"]) for row in dom.rows if row["class"].startswith("stable")]
    assert seen == sorted(m.observations for m in desk.map.landmarks)


def test_a_script_in_a_label_would_not_run_even_if_it_were_not_escaped(chromium, report, tmp_path):
    path, _ = report
    broken = tmp_path / "broken.html"
    deed = "document.documentElement.dataset.attacked = 'yes'"
    attack = f'<script>{deed}</script><img src=x onerror="{deed}">'
    broken.write_text(path.read_text(encoding="utf-8").replace("<h1>", f"<h1>{attack}"), encoding="utf-8")
    dom = Dom(chromium(broken.as_uri(), 1200, "--dump-dom"))
    assert dom.root["data-overflow"] == "false"  # our own script did run
    assert "data-attacked" not in dom.root


@pytest.mark.parametrize("objects", [0, 1, 300])
def test_any_number_of_landmarks_fits_a_phone(chromium, tmp_path, objects):
    desk = make_desk(objects, labels=("a label of quite some length", "Donaudampfschifffahrtskapitaensmuetze" * 3), tentative=objects // 4)
    path = tmp_path / "report.html"
    if objects == 0:
        empty = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
        write_report(path, map=MadeUpMap(gravity="unknown"), trajectory=empty, recorder=None, run={})
    else:
        write_report(path, **desk.arguments)
    dom = Dom(chromium(framed(path, 360, tmp_path / "framed.html").as_uri(), 1400, "--dump-dom"))
    assert dom.root["data-viewport"] == "360"
    assert len(json.loads(dom.data)["landmarks"]) == objects - objects // 4
    assert dom.root["data-overflow"] == "false"
