"""Measured fields: bilinear between samples, equal from every file format, and clear about what was not measured."""

from __future__ import annotations

import math
import pickle
import re

import numpy as np
import pytest
import shapely
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

import hpop
from hpop.errors import MapError
from hpop.world import MeasuredField, World, read_field
from hpop.world.fields.symbols import Quadratics, looking

RNG = np.random.default_rng(39)
VALUES = RNG.integers(0, 256, (7, 11)) / 255.0 * 60.0 - 90.0  # dBm, as an image of 8 bits can hold them
X0, Y0, SPACING, YAW = 2.0, -1.0, 0.5, 0.3
WIFI = {"name": "wifi", "unit": "dBm"}
FIELD = MeasuredField(VALUES, SPACING, (X0, Y0, YAW), **WIFI)
ROOM = World.from_polygons([], extent=shapely.box(0, 0, 5, 3))


def in_world(u, v, pose=(X0, Y0, YAW)):
    """Return world positions of points (u, v), m, in the frame of the field."""
    x, y, yaw = pose
    return x + math.cos(yaw) * u - math.sin(yaw) * v, y + math.sin(yaw) * u + math.cos(yaw) * v


def oracle(u, v, values=VALUES):
    rows, columns = values.shape
    axes = SPACING * np.arange(rows), SPACING * np.arange(columns)
    return RegularGridInterpolator(axes, values)(np.stack([v, u], axis=1))


U, V = RNG.uniform((0, 0), (5, 3), (200, 2)).T


def test_a_field_is_bilinear_between_its_samples_and_keeps_the_border_value_beyond() -> None:
    assert FIELD(*in_world(U, V)) == pytest.approx(oracle(U, V), abs=1e-10)
    assert FIELD(*in_world(np.array([0.0, 99.0]), np.array([0.5, 99.0]))) == pytest.approx(VALUES[[1, -1], [0, -1]])


def test_its_gradient_is_that_of_finite_differences() -> None:
    x, y = in_world(U, V)
    dx, dy = FIELD.gradient(x, y)
    step = 1e-7
    assert dx == pytest.approx((FIELD(x + step, y) - FIELD(x - step, y)) / (2 * step), abs=1e-4)
    assert dy == pytest.approx((FIELD(x, y + step) - FIELD(x, y - step)) / (2 * step), abs=1e-4)


@pytest.mark.parametrize("kind", ["MX", "SX"])
def test_on_casadi_symbols_it_has_equal_values_and_exact_slopes(kind) -> None:
    import casadi

    from hpop.base.symbols import lift

    x, y = in_world(U[:9], V[:9])
    symbols = [getattr(casadi, kind).sym(name, 9) for name in "xy"]
    columns = [lift(symbol, (9,)) for symbol in symbols]
    if kind == "MX":
        value = casadi.Function("f", symbols, [casadi.vec(FIELD(*columns).to_casadi())])
        assert np.ravel(value(x, y).full()) == pytest.approx(FIELD(x, y), abs=1e-10)
        return
    with looking() as looks:
        value = casadi.vec(FIELD(*columns).to_casadi())
    places = casadi.Function("p", symbols, [casadi.horzcat(*looks.places)])(x, y)
    quadratics = Quadratics(FIELD, 9)
    numbers = quadratics(places)
    slopes = casadi.jacobian(value, symbols[0])
    f = casadi.Function("f", [*symbols, casadi.horzcat(*looks.numbers)], [value, casadi.diag(slopes)])
    found, slope = f(x, y, numbers)
    assert np.ravel(found.full()) == pytest.approx(FIELD(x, y), abs=1e-10)
    assert np.ravel(slope.full()) == pytest.approx(FIELD.gradient(x, y)[0], abs=1e-9)


def written(folder, form):
    """Write the samples in a format; return the path and the options that it needs."""
    rows, columns = np.indices(VALUES.shape)
    grey = np.rint((VALUES + 90.0) / 60.0 * 255).astype(np.uint8)[::-1]
    corner = in_world(-SPACING / 2, -SPACING / 2)
    if form == "csv":
        table = np.column_stack([SPACING * columns.ravel(), SPACING * rows.ravel(), VALUES.ravel()])
        lines = [",".join(map(repr, line)) for line in RNG.permutation(table).tolist()]
        (folder / "f.csv").write_text("\n".join(["x,y,wifi", *lines]))
        return folder / "f.csv", {"origin": (X0, Y0, YAW)}
    if form == "npy":
        np.save(folder / "f.npy", VALUES)
        return folder / "f.npy", {"spacing": SPACING, "origin": (X0, Y0, YAW)}
    Image.fromarray(grey).save(folder / "f.png")
    if form == "png":
        return folder / "f.png", {"spacing": SPACING, "origin": (*corner, YAW), "range": (-90, -30)}
    (folder / "f.yaml").write_text(f"image: f.png\nresolution: {SPACING}\norigin: [{corner[0]}, {corner[1]}, {YAW}]\n")
    return folder / "f.yaml", {"range": (-30, -90)}  # white is 0, black 100


@pytest.mark.parametrize("form", ["csv", "npy", "png", "yaml"])
def test_a_field_is_equal_from_every_format(tmp_path, form) -> None:
    path, options = written(tmp_path, form)
    assert read_field(path, **WIFI, **options)(*in_world(U, V)) == pytest.approx(oracle(U, V), abs=1e-9)


def test_a_field_survives_pickling_and_the_description_of_its_world() -> None:
    holes = VALUES.copy()
    holes[2:4, 5] = np.nan
    world = ROOM.with_fields([MeasuredField(holes, SPACING, name="wifi", unit="dBm", outside=-95.0)])
    for other in (pickle.loads(pickle.dumps(world)), World.from_description(world.describe())):
        assert np.array_equal(other.field()(U, V), world.field("wifi")(U, V))
        assert other.notes == world.notes
    assert repr(world.field()) == (
        f"<MeasuredField 'wifi': 11 x 7 samples, 0.5 m apart, -95 to {VALUES.max():.4g} dBm>"
    )
    assert {"fields", "field wifi"} <= world.contents
    assert world.with_content().fields == world.fields


def test_what_was_not_measured_has_the_stated_value_after_one_step_and_is_told() -> None:
    half = MeasuredField(np.full((7, 5), -50.0), SPACING, name="wifi", unit="dBm", outside=-90.0)  # 0 to 2 m in x
    x = np.array([1.9, 2.0, 2.25, 2.5, 4.0])
    assert half(x, np.full(5, 1.0)) == pytest.approx([-50, -50, -70, -90, -90])
    assert half.is_measured(np.array([-0.24, 2.24, 2.26]), np.ones(3)).tolist() == [True, True, False]
    (note,) = ROOM.with_fields([half]).notes
    share = float(re.fullmatch(r"field 'wifi' was measured in ([\d.]+) % of the free space; .* -90 dBm, .*", note)[1])
    assert share == pytest.approx(100 * 2.25 / 5, abs=1)


def bad_csv(text):
    return lambda folder: (folder / "f.csv").write_text(text) and (folder / "f.csv", {})


def big(folder):
    np.save(folder / "f.npy", np.zeros((2001, 2000)))
    return folder / "f.npy", {"spacing": 1.0}


def pickled(folder):
    np.save(folder / "f.npy", np.array([{}], dtype=object), allow_pickle=True)
    return folder / "f.npy", {"spacing": 1.0}


BAD = {
    "cannot be opened: No such file": lambda folder: (folder / "none.csv", {}),
    "needs a unit, such as dBm": lambda folder: (written(folder, "csv")[0], {"unit": " "}),
    "line 3: expected numbers for x, y and wifi; got '1,0,-'": bad_csv("x,y,wifi\n0,0,-40\n1,0,-\n"),
    "1 of 2 samples that are missing or NaN, the first at row 0, column 1": bad_csv("x,y,wifi\n0,0,-40\n1,0,nan\n"),
    "1 of 4 samples that are missing or NaN": bad_csv("x,y,wifi\n0,0,-40\n1,0,-50\n0,1,-60\n"),
    "needs a header with x, y and wifi": bad_csv("a,b,wifi\n0,0,-40\n"),
    "two values for one place": bad_csv("x,y,value\n0,0,1\n1,0,2\n1,0,3\n"),
    r"\(0.3, 0.7\) m is off that grid": bad_csv("x,y,value\n0,0,1\n0.3,0.7,2\n0.8,0,3\n"),
    "at two places at least": bad_csv("x,y,value\n0,0,1\n"),
    "has a header but no points": bad_csv("x,y,value\n"),
    "x and y of each point must be finite; those of point 2 are not": bad_csv("x,y,value\n0,0,1\nnan,0,2\n"),
    "spans a grid of 2,001 x 2,000 points at its smallest step": bad_csv("x,y,value\n0,0,1\n1,0,2\n2000,1999,3\n"),
    "2000 x 2001 samples; at most 4,000,000": big,
    "no array of numbers that NumPy saved": pickled,
    "needs spacing": lambda folder: (written(folder, "npy")[0], {}),
    "needs range": lambda folder: (written(folder, "png")[0], {"spacing": 1.0}),
    "has no use for spacing": lambda folder: (written(folder, "csv")[0], {"spacing": 1.0}),
}


@pytest.mark.parametrize("said", BAD)
def test_a_bad_file_is_refused_with_the_reason(tmp_path, said) -> None:
    path, options = BAD[said](tmp_path)
    with pytest.raises(MapError, match=said):
        read_field(path, **{**WIFI, **options})


@pytest.mark.parametrize(
    ("values", "origin", "said"),
    [
        (VALUES[:, :5], (0.0, 0.0, 0.0), "covers 45.* % of the free space of the map; state the value, in dBm"),
        (VALUES, (90.0, 0.0, 0.0), "covers no free space of the map: it spans 90 to 95 m in x.* the map 0 to 5 m in x"),
        (np.full((2, 2), np.inf), (0.0, 0.0, 0.0), "needs samples that are numbers within"),
        (np.zeros(3), (0.0, 0.0, 0.0), r"needs a grid of samples \(H, W\); got an array of shape \(3,\)"),
    ],
)
def test_a_field_that_does_not_fit_its_map_is_refused(values, origin, said) -> None:
    with pytest.raises(MapError, match=said):
        ROOM.with_fields([MeasuredField(values, SPACING, origin, **WIFI)])


def test_names_of_fields_are_unique_and_an_unknown_one_is_told_the_nearest() -> None:
    field = MeasuredField(VALUES, SPACING, **WIFI)
    with pytest.raises(MapError, match="'wifi' is given more than once"):
        ROOM.with_fields([field, field])
    with pytest.raises(MapError, match=r"no field is called 'wify'\. Did you mean 'wifi'"):
        ROOM.with_fields([field]).field("wify")


def test_a_scenario_reads_fields_and_its_map_shows_the_one_of_a_criterion(tmp_path) -> None:
    from hpop.scenario import load_scenario
    from hpop.view import draw_map

    path, _ = written(tmp_path, "csv")
    text = (
        "world: {polygons: {extent: [[0, 0], [5, 0], [5, 3], [0, 3]]}}\nmodel: differential_drive\n"
        "start: [0.5, 0.5, 0]\ngoal: [4.5, 2.5, any]\nplanner: {lattice: {step: 1}}\n"
        "criteria: [{field_worst: {field: wifi, good: -40, bad: -80}}, turns, length]\n"
    )
    scenario = tmp_path / "s.yaml"
    scenario.write_text(f"{text}fields: [{{name: wifi, path: {path.name}, unit: dBm}}]\n")
    problem = load_scenario(scenario).problem
    assert problem.world.field("wifi")(U, V) == pytest.approx(oracle(U, V))
    front = problem.solve(planner="lattice", step=1.0)
    figure = draw_map(problem, front)
    assert "wifi (dBm)" in {axes.get_ylabel() for axes in figure.axes}
    front.save(tmp_path / "front.json")
    assert hpop.Front.load(tmp_path / "front.json").problem["world"]["fields"][0]["unit"] == "dBm"
    scenario.write_text(f"{text}fields: [{{name: wifi, path: {path.name}}}, {{name: b, path: no.csv, unit: m}}]\n")
    with pytest.raises(
        hpop.errors.HpopError, match=r"(?s)fields.*unit: this key is missing.*no.csv.* cannot be opened"
    ):
        load_scenario(scenario)
