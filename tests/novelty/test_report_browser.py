"""The page in a real browser, without a network."""

from dataclasses import replace

import pytest

from novelty.evaluation import evaluate_labels
from novelty.report import Run, write_report
from novelty.result import PointState
from tests.novelty.report_case import SETTINGS, make_pair, make_result

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    from selenium.webdriver.support.ui import WebDriverWait

    pair = make_pair(num_points=3000)
    result = make_result(pair)
    states = result.removed.point_states.copy()
    states[:300], states[300:600], states[600:700] = (
        PointState.OCCLUDED,
        PointState.UNOBSERVED,
        PointState.MOVED,
    )
    result = replace(result, removed=replace(result.removed, point_states=states))
    path = tmp_path_factory.mktemp("page") / "report.html"
    scores = {"added": evaluate_labels(pair.current.labels, result.added.point_labels)}
    write_report(path, pair, result, Run(SETTINGS), scores)
    browser.get(path.as_uri())
    WebDriverWait(browser, 120).until(
        lambda session: session.execute_script("return document.body.dataset.ready") == "true"
    )
    return browser


def visible_layers(page, view):
    return page.execute_script(
        f"return [...new Set(document.getElementById('view-{view}').data"
        ".filter((trace) => trace.visible !== false).map((trace) => trace.meta.layer))].sort()"
    )


def press(page, label):
    from selenium.webdriver.common.by import By

    (button,) = [b for b in page.find_elements(By.TAG_NAME, "button") if b.text == label]
    button.click()


def test_opens_without_errors_on_the_console(page):
    assert [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_draws_both_scans_and_the_path(page):
    drawn = page.execute_script(
        "return ['added', 'removed', 'mdl'].map((kind) => document.getElementById(`view-${kind}`)"
        ".querySelectorAll('canvas, svg.main-svg').length > 0)"
    )
    assert drawn == [True, True, True]


def test_first_shows_points_then_the_mixture_on_demand(page):
    assert visible_layers(page, "added") == ["objects", "points"]
    press(page, "Mixture")
    assert visible_layers(page, "added") == visible_layers(page, "removed") == ["mixture", "objects"]
    press(page, "Points")
    assert visible_layers(page, "removed") == ["objects", "points"]


def test_views_turn_together(page):
    turned = page.execute_async_script(
        "const done = arguments[0]; const eye = { x: 0.1, y: 2, z: 0.3 };"
        "Plotly.relayout('view-added', { 'scene.camera': { eye, up: { x: 0, y: 0, z: 1 } } })"
        ".then(() => setTimeout(() => done(document.getElementById('view-removed').layout.scene.camera.eye), 500));"
    )
    assert turned == {"x": 0.1, "y": 2, "z": 0.3}


@pytest.mark.parametrize("width", [390, 820, 1400])
def test_never_scrolls_sideways(page, width):
    page.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    assert page.execute_script("return document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("width", [360, 420, 820])
def test_no_legend_is_cut(page, width):
    from selenium.webdriver.support.ui import WebDriverWait

    page.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    page.refresh()
    WebDriverWait(page, 120).until(
        lambda session: session.execute_script("return document.body.dataset.ready") == "true"
    )
    beyond = page.execute_script(
        "return [...document.querySelectorAll('.view')].flatMap((view) =>"
        "[...view.querySelectorAll('.legend .traces')].map((entry) =>"
        "entry.querySelector('.legendtext').getBoundingClientRect().right - view.getBoundingClientRect().right))"
    )
    assert len(beyond) >= 8
    assert max(beyond) <= 0
