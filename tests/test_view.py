"""The page of a cube: what it holds, and what a headless browser shows of it, read back and compared with the cube."""

from __future__ import annotations

import base64
import itertools
import json
import re
import shlex
import shutil
import time
import zlib

import figure_data as made
import numpy as np
import pytest
from test_cli import cli

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError
from pounding_sweep.output.netcdf import write_cube
from pounding_sweep.output.select import select
from pounding_sweep.pages import view as module
from pounding_sweep.variables.registry import Status

pytest.importorskip("plotly", reason="needs plotly: pip install 'pounding-sweep[view]'")


def values_in(text, name):
    """Numbers of a field as the page holds them."""
    packed = re.search(rf'data-name="{name}">([^<]*)<', text)[1]
    raw = np.frombuffer(zlib.decompress(base64.b64decode(packed)), "u1")
    return np.ascontiguousarray(raw.reshape(4, -1).T).view("<f4").ravel()


def content_of(text):
    return json.loads(re.search(r'id="cube">(.*?)</script>', text, re.DOTALL)[1])


def hard_cube():
    """A cube with every status, values missing where it says so, and names that need escapes."""
    cube = made.cube(gap=5, record=3)
    status = np.arange(cube["status"].size).reshape(cube["status"].shape) % len(Status)
    cube["status"] = cube["status"].copy(data=status.astype(np.int8))
    lost = cube["status"].isin([status for status in Status if not status.has_values])
    named = cube.assign({name: part.where(~lost) for name, part in cube.data_vars.items() if part.dtype.kind == "f"})
    names = ["it's", 'the "Großes <b>Haus</b>" & more', "r=3; $(ls)"]
    return named.assign_coords(record=("record", names, cube["record"].attrs)).assign_attrs(
        title="Häuser <i>&amp;</i> 'x'"
    )


# --- what the page holds ---


def test_values_of_a_page_are_those_of_the_cube(tmp_path, monkeypatch):
    cube = made.cube(gap=5)
    text = ps.view(cube, tmp_path / "a.html").read_text("utf-8")
    for name in ("impact_force_max", "displacement_min", "impact_count", "status"):
        np.testing.assert_array_equal(values_in(text, name), cube[name].values.astype("f4").ravel())
    assert content_of(text)["rounded"] is False
    monkeypatch.setattr(module, "MOST_EXACT", 100)
    text = ps.view(cube, tmp_path / "a.html", names=["impact_force_max"]).read_text("utf-8")
    rounded, exact = values_in(text, "impact_force_max"), cube["impact_force_max"].values.ravel()
    error = np.nanmax(abs(rounded / exact - 1.0))
    assert 1e-6 < error <= 2.0**-13 + 1e-7
    np.testing.assert_array_equal(np.isnan(rounded), np.isnan(exact))
    assert "rounded to 12 bits after the first (0.012 %)" in text
    assert "displacement_max" not in content_of(text)["fields"]


def test_a_page_is_one_file_that_names_no_other(tmp_path):
    text = ps.view(hard_cube(), tmp_path / "a.html").read_text("utf-8")
    own = re.sub(r"<script type=\"application/octet-stream\"[^>]*>[^<]*</script>", "", text)
    assert not re.search(r"https?://(?!www\.w3\.org)", own)
    assert not re.search(r"\b(src|href)=(?!\"data:,\")", own)
    assert "<b>Haus" not in text


def test_what_no_page_is_made_of(tmp_path, monkeypatch):
    cube = made.cube()
    with pytest.raises(InputError, match=r"'impact_force'.*impact_force_max"):
        ps.view(cube, tmp_path / "a.html", names=["impact_force"])
    with pytest.raises(InputError, match="has no statuses of scenarios"):
        ps.view(made.histories(), tmp_path / "a.html")
    with pytest.raises(InputError, match="needs a variable of numbers"):
        ps.view(cube.drop_vars("error_estimate"), tmp_path / "a.html", names=["status"])
    monkeypatch.setattr(module, "MOST_NUMBERS", 1000)
    words = r"0\.00\d+ million numbers .*may hold 0\.001 .*--var .*impact_force_max 7\.2e-05.*3 laws x 4 gaps"
    with pytest.raises(InputError, match=words):
        ps.view(cube, tmp_path / "a.html")
    ps.view(cube, tmp_path / "a.html", names=["impact_count"], at={"law": "linear", "gap": ["0.002", "0.004"]})
    monkeypatch.setattr(module, "files", lambda name: (_ for _ in ()).throw(ImportError))
    with pytest.raises(InputError, match=r"pip install 'pounding-sweep\[view\]'"):
        ps.view(cube, tmp_path / "a.html")


def test_the_command_writes_a_page_beside_you(tmp_path):
    write_cube(made.cube(), tmp_path / "my cube.nc")
    printed = cli("view", "my cube.nc", "--at", "law=linear", "--var", "impact_count", cwd=tmp_path).stdout
    assert printed.strip().endswith("my cube.html")
    content = content_of((tmp_path / "my cube.html").read_text("utf-8"))
    assert (content["file"], content["dims"]["law"]["values"]) == ("my cube.nc", ["linear"])
    assert content["command"] == "pounding-sweep simulate 'my cube.nc'"


# --- what a browser shows ---


class Browser:
    """Chromium without a window, its faults and its requests."""

    def __init__(self, folder):
        webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium")
        chromium, driver = map(shutil.which, ("chromium", "chromedriver"))
        if not (chromium and driver):
            pytest.skip("needs chromium and chromedriver: apt-get install chromium chromium-driver")
        options = webdriver.ChromeOptions()
        options.binary_location = chromium
        flags = "headless no-sandbox disable-gpu no-first-run disable-background-networking disable-component-update"
        for flag in (*flags.split(), "disable-sync", f"user-data-dir={folder}", "window-size=1280,1200"):
            options.add_argument(f"--{flag}")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
        self.run = self.driver.execute_script
        self.driver.get("about:blank")
        self.driver.get_log("performance")  # of its first tab

    def open(self, path):
        """Open a page, wait until it is drawn, and see that it asked for nothing else."""
        self.driver.get(path.as_uri())
        self.until("return document.body.dataset.ready")
        self.check(path)

    def check(self, path):
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
        assert {url for url in urls if not url.startswith("data:")} <= {path.as_uri()}
        assert [entry["message"] for entry in self.driver.get_log("browser")] == []

    def until(self, script):
        end = time.monotonic() + 60.0
        while not (result := self.run(script)):
            assert time.monotonic() < end, script
            time.sleep(0.02)
        return result

    def set(self, selector, value):
        """Set a control as a user does, and wait for what is drawn of it."""
        self.run(
            "const it = document.querySelector(arguments[0]);"
            "if (it.type === 'radio' || it.type === 'checkbox') it.checked = true; else it.value = arguments[1];"
            "it.dispatchEvent(new Event('input', {bubbles: true}));"
            "window.next = false; requestAnimationFrame(() => requestAnimationFrame(() => { window.next = true; }));",
            selector,
            value,
        )
        self.until("return window.next")

    def traces(self):
        keys = "['x', 'y', 'z', 'name', 'type', 'yaxis', 'text']"
        return self.run(
            "return document.getElementById('figure').data.map((trace) => Object.fromEntries("
            f"{keys}.map((key) => [key, trace[key] && typeof trace[key] !== 'string' ? Array.from(trace[key], "
            "(one) => typeof one === 'object' && one ? Array.from(one) : one) : trace[key]])))"
        )

    def text(self, selector):
        return self.run(
            "return document.querySelector(arguments[0]).textContent.replace(/\\s+/g, ' ').trim()", selector
        )

    def scenario(self):
        """What the page chose: the values of its command."""
        command = shlex.split(self.text("#command"))
        return [item.partition("=")[::2] for flag, item in itertools.pairwise(command) if flag == "--at"]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.driver.quit()


def drawn(values):
    """As a page draws numbers."""
    return [None if not np.isfinite(value) else np.float32(value) for value in values]


def largest(part):
    """The value of the largest size over buildings, pairs and storeys, as a page draws it."""
    dims = [dim for dim in ("building", "pair", "storey") if dim in part.dims]
    high, low = part.max(dims), part.min(dims)
    return high.where(abs(high) >= abs(low), low)


def same(traces, expected):
    for trace, values in zip(traces, expected, strict=True):
        np.testing.assert_array_equal(np.array(trace, float), np.array(drawn(values), float))


def test_sliders_change_what_is_drawn_to_values_of_the_cube(browser, tmp_path):
    cube = made.cube(gap=5, stiffness_factor=3, scale=2)
    browser.open(ps.view(cube, tmp_path / "a.html"))
    at = {"stiffness_factor": 1, "restitution": 0, "scale": 1, "record": 0}
    for dim in ("stiffness_factor", "restitution", "scale"):
        browser.set(f"[data-dim={dim}]", at[dim])
    force = largest(cube["impact_force_max"].isel(at))
    lines = browser.traces()[:3]
    assert [line["name"] for line in lines] == ["linear", "kelvin_voigt", "none"]
    assert lines[0]["x"] == cube["gap"].values.tolist()
    same([line["y"] for line in lines], force.transpose("law", "gap").values)
    from selenium.webdriver.common.keys import Keys

    slider = browser.driver.find_element("css selector", "[data-dim=scale]")
    slider.send_keys(Keys.ARROW_LEFT)
    browser.until("return document.querySelector('[data-dim=scale]').parentElement.textContent.includes('0.5')")
    slower = largest(cube["impact_force_max"].isel(at | {"scale": 0}))
    same([line["y"] for line in browser.traces()[:3]], slower.transpose("law", "gap").values)
    slider.send_keys(Keys.ARROW_RIGHT)
    browser.set("#output", "displacement_min")
    browser.set("[data-dim=building]", 1)
    browser.set("#across", "stiffness_factor")
    browser.set("#per", "scale")
    place = {"restitution": 0, "record": 0, "building": 1}
    law, gap = (int(browser.run(f"return document.querySelector('[data-dim={dim}]').value")) for dim in ("law", "gap"))
    motion = largest(cube["displacement_min"].isel(place | {"law": law, "gap": gap}))
    same([line["y"] for line in browser.traces()[:2]], motion.transpose("scale", "stiffness_factor").values)
    browser.set("#across", "storey")
    storeys = cube["displacement_min"].isel(place | {"law": law, "gap": gap, "stiffness_factor": 1})
    same([line["y"] for line in browser.traces()[:2]], storeys.transpose("scale", "storey").values)
    browser.set("[value=map]", "")
    browser.set("#output", "impact_count")
    browser.set("#across", "gap")
    browser.set("#up", "law")
    count = largest(cube["impact_count"].isel(at))
    same(browser.traces()[0]["z"], count.transpose("law", "gap").values)
    browser.set("#up", "building")  # which is not offered, as this output has none
    assert browser.text("#note") == "impact_count has no axis building: values along it are equal"
    offered = browser.run("return [...document.querySelectorAll('#up option:enabled')].map((option) => option.value)")
    assert {"gap", "storey"} < {*offered}
    assert "building" not in offered
    browser.check(tmp_path / "a.html")


def test_a_click_shows_the_scenario_of_the_cube(browser, tmp_path, stub_engine):
    """Its coordinates, outputs and error, and a command that replays it."""
    from selenium.webdriver.common.action_chains import ActionChains

    cube = made.cube(gap=5, record=2)
    write_cube(cube, tmp_path / "cube.nc")
    with ps.open_cube(tmp_path / "cube.nc") as opened:
        browser.open(ps.view(opened, tmp_path / "a.html"))
    x, y = browser.run(
        "const gd = document.getElementById('figure'), {xaxis, yaxis} = gd._fullLayout;"
        "const [box, {x, y}] = [gd.getBoundingClientRect(), gd.data[1]];"
        "return [box.x + xaxis._offset + xaxis.l2p(x[2]), box.y + yaxis._offset + yaxis.l2p(y[2])]"
    )
    pointer = ActionChains(browser.driver)
    pointer.w3c_actions.pointer_action.move_to_location(round(x), round(y))
    pointer.perform()
    hover = browser.until("return document.querySelector('.hoverlayer').textContent")
    ActionChains(browser.driver).click().perform()
    browser.until("return document.getElementById('command').textContent.includes('kelvin_voigt')")
    choice = dict(browser.scenario())
    assert (choice["law"], float(choice["gap"])) == ("kelvin_voigt", cube["gap"].values[2])
    one = select(cube, choice)
    force = f"{float(largest(one['impact_force_max'])):.6g}"
    assert hover == f"kelvin_voigtgap {one['gap'].item():g} mimpact_force_max {force} kN"
    for name in ("impact_force_max", "displacement_min", "drift_max"):
        value = float(largest(one[name]))
        shown = browser.text(f"[data-result={name}] td:nth-child(2)")
        assert float(shown.split()[0]) == pytest.approx(value, rel=1e-5)
    assert browser.text("[data-input=record_pga]") == f"{float(one['record_pga']):.6g} m·s-2"
    assert browser.text("#status").startswith("Status: ok: the scenario ran to the end")
    assert float(browser.text("#error").split(": ")[1].split()[0]) == pytest.approx(
        float(one["error_estimate"]), rel=0.1
    )
    cli(*shlex.split(browser.text("#command"))[1:], cwd=tmp_path)
    with ps.open_cube(tmp_path / "one.nc") as replayed:
        assert (replayed.attrs["law"], replayed.attrs["record"]) == ("kelvin_voigt", choice["record"])
        assert float(replayed["pair_gap"][0]) == float(choice["gap"])


def test_the_worst_scenarios_are_those_of_the_cube(browser, tmp_path):
    cube = made.cube(gap=5, record=2)
    cube["run"] = (
        cube["status"].astype(np.int32).copy(data=np.arange(1, cube["status"].size + 1).reshape(cube["status"].shape))
    )
    for name in ("run", "impact_force_max", "displacement_max"):
        cube[name][{"restitution": 1}] = cube[name][{"restitution": 0}]  # one run for both
    browser.open(ps.view(cube, tmp_path / "a.html"))

    def check(name, expected):
        rows = browser.run("return [...document.querySelectorAll('#worst button')].map((button) => button.textContent)")
        np.testing.assert_allclose([float(row.split()[0]) for row in rows], expected[:25], rtol=1e-5)
        browser.run("document.querySelectorAll('#worst button')[3].click()")
        time.sleep(0.1)
        return select(cube, dict(browser.scenario()))[name]

    expected = np.sort(largest(cube["impact_force_max"].isel(restitution=0)).values.ravel())[::-1]
    assert float(largest(check("impact_force_max", expected))) == pytest.approx(expected[3])
    browser.set("#by", "displacement_max")
    browser.set("#order", "smallest")
    motion = cube["displacement_max"].isel(restitution=0).min(["building", "storey"])
    expected = np.sort(motion.values.ravel())
    assert float(check("displacement_max", expected).min()) == pytest.approx(expected[3])
    assert browser.text("#output option:checked") == "largest contact force"


def test_what_is_not_ok_is_marked(browser, tmp_path):
    cube = hard_cube()
    browser.open(ps.view(cube, tmp_path / "a.html"))
    browser.set("#per", "")
    browser.set("[data-dim=law]", 0)
    browser.set("[data-dim=restitution]", 0)
    for number, name in enumerate(cube["record"].values):
        browser.set("[data-dim=record]", number)
        choice = dict(browser.scenario())
        assert choice["record"] == name
        codes = cube["status"].isel(law=0, restitution=0, record=number, scale=0, stiffness_factor=0).values
        bad = {trace["name"]: trace for trace in browser.traces()}
        lost = np.isin(codes, [status for status in Status if not status.has_values])
        assert len(bad.get("no value", {"x": []})["x"]) == lost.sum()
        assert len(bad.get("not ok", {"x": []})["x"]) == (~lost & (codes != 0)).sum()
        for code in codes[codes != 0]:
            assert Status(code).label in browser.text("#note")
    browser.set("[value=map]", "")
    browser.set("#up", "record")
    codes = cube["status"].isel(law=0, restitution=0, scale=0, stiffness_factor=0)
    assert len(browser.traces()[1]["x"]) == int((codes != 0).sum())
    assert [len(row) for row in browser.traces()[0]["z"]] == [5, 5, 5]
    ticks = browser.run("return [...document.querySelectorAll('.ytick text')].map((tick) => tick.textContent)")
    assert ticks == cube["record"].values.tolist()
    browser.check(tmp_path / "a.html")


def one_axis():
    return made.cube(law=1, gap=200, restitution=1)


def none_ok():
    cube = made.cube()
    cube["status"][:] = int(Status.DIVERGED)
    return cube.assign({name: part * np.nan for name, part in cube.data_vars.items() if part.dtype.kind == "f"})


CUBES = {
    "none ok": (none_ok, "No scenario is ok: 24 diverged"),
    "one axis": (one_axis, ""),
    "one scenario, a wall": (lambda: made.cube(law=1, gap=1, restitution=1, right_wall=True), ""),
    "cases": (made.design, ""),
    "without its sweep": (lambda: made.cube().drop_attrs(deep=False), ""),
}


@pytest.mark.parametrize("key", CUBES)
def test_hard_cubes_have_a_page(browser, tmp_path, key):
    make, warning = CUBES[key]
    cube = make()
    path = ps.view(cube, tmp_path / "a.html")
    browser.open(path)
    assert browser.text("#warning").startswith(warning)
    lines = [trace for trace in browser.traces() if trace["name"] not in ("no value", "not ok", None)]
    if key == "none ok":
        assert "has no value here" in browser.text("#note")
        assert "no value" in browser.text("[data-result=impact_force_max]")
    if key == "one axis":
        same([lines[0]["y"]], [largest(cube["impact_force_max"]).values.ravel()])
    if key == "cases":
        browser.set("[data-dim=case]", 4)
        assert browser.scenario() == [("case", "5")]
        browser.set("[value=map]", "")
        browser.set("#across", "gap")
        browser.set("#up", "scale")
        trace = browser.traces()[0]
        same([trace["x"], trace["y"]], [cube["gap"].values, cube["scale"].values])
    if key == "without its sweep":
        assert "does not carry its sweep" in browser.text("main")
    browser.check(path)
