"""The report of a sweep in a real browser, without a network: everything on it can be clicked."""

import pytest

from novelty.report.sweep import SweepRuns, write_sweep_page
from tests.novelty.report.sweep_case import make_sweep

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    from selenium.webdriver.support.ui import WebDriverWait

    folder, other = tmp_path_factory.mktemp("sweep"), tmp_path_factory.mktemp("other")
    conditions = ({"pose_error": 0.0}, {"pose_error": 0.1})
    make_sweep(folder, conditions=conditions, failing=(5,), keep=(0, 1, 2, 3, 4))
    make_sweep(other, conditions=conditions, skill=0.02)
    write_sweep_page(folder / "report.html", SweepRuns.read(folder), other=SweepRuns.read(other))
    browser.get((folder / "report.html").as_uri())
    WebDriverWait(browser, 120).until(
        lambda session: session.execute_script("return document.body.dataset.ready") == "true"
    )
    return browser


def press(page, attribute, value):
    from selenium.webdriver.common.by import By

    page.find_element(By.CSS_SELECTOR, f'[data-{attribute}="{value}"]').click()


def visible(page, selector):
    return page.execute_script(
        f"return [...document.querySelectorAll('{selector}')].filter((e) => e.offsetParent).length"
    )


def drawn(page, name):
    return page.execute_script(
        f"return document.getElementById('{name}').data.filter((t) => t.visible !== false)"
    )


def test_opens_without_errors_on_the_console(page):
    assert [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_draws_every_figure(page):
    for name in ("effect", "plot-chosen", "plot-shares", "plot-paths", "plot-costs"):
        assert page.execute_script(f"return document.querySelectorAll('#{name} svg.main-svg').length") > 0, (
            name
        )


def test_another_score_changes_the_figure_and_the_table(page):
    before = drawn(page, "effect")[-1]["y"]
    press(page, "metric", "uncertainty")
    assert drawn(page, "effect")[-1]["y"] != before
    assert visible(page, "[data-metric-table=uncertainty]") == 1
    assert visible(page, "[data-metric-table=kappa]") == 0
    press(page, "metric", "kappa")
    assert drawn(page, "effect")[-1]["y"] == before


def test_another_factor_has_its_own_axis_and_table(page):
    assert drawn(page, "effect")[-1]["x"] == [8, 12, 20]
    press(page, "study", "pose_error")
    assert drawn(page, "effect")[-1]["x"] == [0.0, 0.1]
    assert visible(page, "[data-of-study=pose_error] [data-metric-table=kappa]") == 1
    assert visible(page, "[data-of-study=max_components] [data-metric-table=kappa]") == 0
    press(page, "study", "max_components")


def test_the_bands_show_intervals_or_quartiles(page):
    def bands():
        return {trace["meta"]["band"] for trace in drawn(page, "effect") if "meta" in trace}

    assert bands() == {"interval"}
    press(page, "band", "quartiles")
    assert bands() == {"quartiles"}
    press(page, "band", "interval")


def test_the_comparison_shows_one_quantity_at_a_time(page):
    press(page, "compared", "seconds")
    assert visible(page, "[data-of-compared=seconds] table") == 1
    assert visible(page, "[data-of-compared=kappa] table") == 0
    press(page, "compared", "kappa")


def test_a_pair_is_viewed_on_demand_with_points_or_ellipsoids(page):
    from selenium.webdriver.support.ui import WebDriverWait

    assert visible(page, "#viewer") == 0
    run = page.execute_script("return document.querySelector('[data-run]').dataset.run")
    press(page, "run", run)
    WebDriverWait(page, 120).until(
        lambda session: (
            session.execute_script("return document.getElementById('viewer').dataset.drawn") == run
        )
    )
    assert {trace["type"] for trace in drawn(page, "view-added")} == {"scatter3d"}
    press(page, "layers", "mixture")
    assert {trace["type"] for trace in drawn(page, "view-removed")} == {"mesh3d"}
    press(page, "layers", "points")


def test_light_and_dark_can_be_chosen_and_the_figures_follow(page):
    colours = {}
    for theme in ("light", "dark"):
        press(page, "set-theme", theme)
        colours[theme] = page.execute_script(
            "return [getComputedStyle(document.body).backgroundColor, "
            "document.getElementById('effect').layout.font.color]"
        )
    assert colours["light"][0] == "rgb(255, 255, 255)"
    assert colours["dark"][0] == "rgb(20, 24, 30)"
    assert colours["light"][1] != colours["dark"][1]
    press(page, "set-theme", "")


def test_prints_with_figures_as_wide_as_the_paper(page):
    page.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    widths = page.execute_script(
        "return ['effect', 'plot-costs'].map((n) => document.getElementById(n)._fullLayout.width)"
    )
    page.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert widths == [680, 680]
    assert page.execute_script("return document.getElementById('effect')._fullLayout.width") != 680


@pytest.mark.parametrize("width", [390, 820, 1280])
def test_never_scrolls_sideways(page, width):
    page.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    assert page.execute_script("return document.documentElement.scrollWidth") <= width
