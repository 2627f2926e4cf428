"""Conformance checks of models: those of hpop and its example pass, and each kind of mistake fails the right check."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.base.registry import make_model, models
from hpop.errors import ModelError
from hpop.motions import Phase, States
from hpop.testing import check_model, conformance
from tests.two_arms import two_arms

PLUGIN = Path(__file__).resolve().parents[2] / "examples/plugin"
DESCRIBED = "can be made again from its description"
SPACE = "reads and writes its states"
PROVIDES = "has everything that it says it provides"
SAYS = "has valid optional attributes"
LED = "has laws that lead from start to end"
AXES = "has poses with axes at right angles"
TWISTS = "has twists that agree with the changes of its poses"
BODIES = "gives lengths and rotations of bodies that agree with their poses"
EXTENT = "moves no body farther than its extent"
JUDGED = "has a collision test that accepts nothing its judge refuses"
CONNECTED = "connects states by motions that lead there"
STATIONS = "has stations that are joined by motions in place"
EXECUTED = "executes a plan from its start to its end"
FAULTLESS = "finds no fault in its own trajectories"
CLAIMS = DESCRIBED, SPACE, PROVIDES, SAYS, LED, AXES, TWISTS, BODIES, EXTENT, JUDGED, CONNECTED, EXECUTED, FAULTLESS


def plugin() -> ModuleType:
    sys.path.insert(0, str(PLUGIN))
    try:
        return importlib.import_module("hpop_example_plugin.holonomic")
    finally:
        sys.path.remove(str(PLUGIN))


Holonomic, Slide = plugin().Holonomic, plugin().Slide
GOOD = {
    "holonomic": Holonomic(),
    "differential drive": hpop.DifferentialDrive(),
    "camera beside the axis, and a long base": hpop.DifferentialDrive(
        camera_offset=(0.2, -0.1), footprint=((0.5, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.5, -0.2))
    ),
    "unwound": hpop.ViewModel(yaw=0.7),
}


@pytest.mark.cases("holonomic", "camera beside the axis, and a long base")
@pytest.mark.parametrize("model", GOOD.values(), ids=GOOD)
def test_the_robots_of_the_house_and_of_its_example_pass_every_check(model: Any) -> None:
    checks = list(conformance(model))
    assert [check for check in checks if check.fault] == []
    stations = [STATIONS] * ("turn-move" in model.provides)
    assert [check.claim for check in checks] == [*CLAIMS[:-2], *stations, *CLAIMS[-2:]]


@pytest.fixture(autouse=True)
def few_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check fewer motions: the judge is slow, above all that of an arm, and motions are sampled one by one."""
    monkeypatch.setattr("hpop.testing.models.JUDGED", 30)
    monkeypatch.setattr("hpop.testing.models.PAIRS", 5)


def registered() -> list[str]:
    """Return the names of hpop's models."""
    return [name for name, cls in models.items() if cls.__module__.startswith("hpop.")]


ARM = Path(__file__).resolve().parents[2] / "examples/arm"
ARM6: dict[str, Any] = {
    "urdf": str(ARM / "arm6.urdf"),
    "srdf": str(ARM / "arm6.srdf"),
    "tip": "tool",
    "acceleration": 6.0,
    "camera": [-0.06, 0.0, -0.08, 0.0, -1.5707963267948966, 0.0],
}
NEEDED: dict[str, dict[str, Any]] = {
    "mobile_arm": {"arm": {"serial_arm": {**ARM6, "base": [0.05, 0.0, 0.4, 0.0, 0.0, 0.3]}}},
    "pan_tilt": {"base": {"differential_drive": {}}},
    "serial_arm": {**ARM6, "base": [6.0, 4.5, 0.2, 0.0, 0.0, 0.0]},  # in the middle of the room
    "two_arms": two_arms().describe()["two_arms"],
}


#: One that takes seconds, and one that passes with its camera elsewhere.
DEAR = ("mobile_arm", "differential_drive")


@pytest.mark.cases("pan_tilt")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.proof) if name in DEAR else name for name in registered()]
)
def test_every_registered_robot_passes(name: str) -> None:
    check_model(make_model({name: NEEDED.get(name, {})}))


@pytest.mark.proof
def test_a_robot_in_time_that_calls_every_pair_of_states_joinable_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hpop.TwoArms, "joinable", lambda model, a, b: np.ones(a.size, dtype=bool))
    (fault,) = [check for check in conformance(two_arms()) if check.fault]
    assert fault.claim == CONNECTED


# Mistakes, planted one at a time: a robot of which one thing is changed


@dataclass(frozen=True)
class Wrong(Holonomic):
    """The plugin's base with other answers, by the name of what is asked."""

    answers: dict[str, Callable[..., Any]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        pass

    def __getattribute__(self, name: str) -> Any:
        answers = super().__getattribute__("__dict__").get("answers", {})
        right = super().__getattribute__(name)
        return answers[name](right) if name in answers else right

    def describe(self) -> dict[str, Any]:
        return {"holonomic": {}}


def turned_about(right: Callable[..., Any]) -> Callable[..., Any]:
    """Return a twist of the wrong sign."""

    def twist(body: str, *given: States) -> Any:
        found = right(body, *given)
        return SimpleNamespace(velocity=found.velocity, rotation=tuple(-part for part in found.rotation))

    return twist


def forgetful(right: Callable[..., Any]) -> Callable[..., Any]:
    """Return a body that reports no turn."""
    return lambda name, motions: replace(right(name, motions), turned=0.0 * motions.duration)


def staying(right: Callable[..., Any]) -> Callable[..., Any]:
    return lambda name, motions: replace(right(name, motions), stays=True)


def short(right: Callable[..., Any]) -> Callable[..., Any]:
    return lambda motions: tuple(0.5 * bound for bound in right(motions))


def kind_to(what: str) -> Callable[..., Any]:
    """Return a collision that is free where it should not be."""

    def collision(right: Callable[..., Any]) -> Callable[..., Any]:
        def of(world: Any) -> Any:
            found = right(world)
            always = {what: lambda asked: np.ones(getattr(asked, "size", 0) or len(asked), dtype=bool)}
            answers = {name: getattr(found, name) for name in ("clear", "yaw_matters", "states_free", "motions_free")}
            return SimpleNamespace(**answers | always, why_blocked=found.why_blocked)

        return of

    return collision


def timid(right: Callable[..., Any]) -> Callable[..., Any]:
    """Return a collision that reports obstacles everywhere."""

    def of(world: Any) -> Any:
        never = lambda asked: np.zeros(getattr(asked, "size", 0) or len(asked), dtype=bool)  # noqa: E731
        return SimpleNamespace(
            clear=None, yaw_matters=True, states_free=never, motions_free=never, why_blocked=lambda state: "it is dark"
        )

    return of


def silent(right: Callable[..., Any]) -> Callable[..., Any]:
    def of(world: Any) -> Any:
        found = right(world)
        return SimpleNamespace(
            states_free=found.states_free, motions_free=found.motions_free, why_blocked=lambda state: ""
        )

    return of


def astray(right: Callable[..., Any]) -> Callable[..., Any]:
    """Legs that lead a centimetre too far."""

    def connect(a: States, b: States) -> Any:
        (leg,) = right(a, b)
        return [leg._replace(end=States(x=leg.end.x + 0.01 * leg.present, y=leg.end.y, yaw=leg.end.yaw))]

    return connect


def jumping(right: Callable[..., Any]) -> Callable[..., Any]:
    """Legs whose yaw is that of b, however far round."""

    def connect(a: States, b: States) -> Any:
        (leg,) = right(a, b)
        return [
            leg._replace(
                end=States(x=leg.end.x, y=leg.end.y, yaw=np.where(leg.present & ~np.isnan(b.yaw), b.yaw, leg.end.yaw))
            )
        ]

    return connect


def unfree(right: Callable[..., Any]) -> Callable[..., Any]:
    """Legs that are not finished where an angle is left free."""

    def connect(a: States, b: States) -> Any:
        (leg,) = right(a, b)
        return [leg._replace(end=States(x=leg.end.x, y=leg.end.y, yaw=leg.end.yaw + 0.0 * b.yaw))]

    return connect


def elsewhere(right: Callable[..., Any]) -> Callable[..., Any]:
    """Return an execution that begins with the second motion."""

    def execution(trajectory: Any) -> Any:
        states = trajectory.states.take(slice(1, None))
        done, passed = right(hpop.Trajectory(trajectory.model, states, trajectory.kinds[1:]))
        return done, np.append(0.0, passed)

    return execution


def unpunctual(right: Callable[..., Any]) -> Callable[..., Any]:
    def execution(trajectory: Any) -> Any:
        done, passed = right(trajectory)
        return done, np.where(np.arange(passed.size) == 1, passed * 0.5, passed)

    return execution


def grumbling(right: Callable[..., Any]) -> Callable[..., Any]:
    return lambda trajectory: iter(["has no battery"])


@dataclass(frozen=True)
class Lagging(Slide):
    """A law that ends elsewhere."""

    def interpolate(self, name: str, start: States, end: States, share: Any) -> Any:
        return super().interpolate(name, start, end, 0.9 * share)


@dataclass(frozen=True)
class Swerving(Slide):
    """A law that turns late, and says so in its slopes, but not that it is one of curves."""

    def interpolate(self, name: str, start: States, end: States, share: Any) -> Any:
        return super().interpolate(name, start, end, share * share if name == "yaw" else share)

    def slopes(self, name: str, start: States, end: States, share: Any) -> tuple[Any, Any]:
        change = getattr(end, name) - getattr(start, name)
        return (2.0 * share * change, 2.0 * change) if name == "yaw" else (change, 0.0)

    def strays(self, start: States, end: States) -> Any:
        return 0.0 * start.x


@dataclass(frozen=True)
class Halting(Slide):
    """Phases that do not add up."""

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        (phase,) = super().phases(start, end)
        return (phase._replace(end=0.5 * phase.end),)


@dataclass(frozen=True)
class Backwards(Slide):
    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        (phase,) = super().phases(start, end)
        return (phase._replace(duration=-phase.duration),)


@dataclass(frozen=True)
class Sluggish(Slide):
    """A law that says it goes back as it came, and takes longer."""

    reversible = True

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        (phase,) = super().phases(start, end)
        return (phase._replace(duration=phase.duration * (1.0 + (end.x > start.x))),)


@dataclass(frozen=True)
class Vague(Slide):
    extra = "clock"


def law(cls: type) -> Callable[..., Any]:
    return lambda laws: {**laws, "slide": cls(1.0, 1.5)}


def lying(right: Callable[..., Any]) -> Callable[..., Any]:
    """Return a pose that looks to the side."""

    def pose(body: str, states: States) -> Any:
        found = right(body, states)
        kept = {name: getattr(found, name) for name in ("x", "y", "z", "yaw", "pitch", "roll", "up")}
        return SimpleNamespace(**kept, ahead=found.left, left=found.ahead)

    return pose


def halved(right: Callable[..., Any]) -> Callable[..., Any]:
    """Return a pose that comes back only after two turns."""
    return lambda body, states: right(body, States(x=states.x, y=states.y, yaw=0.5 * states.yaw))


def says(answer: Any) -> Callable[..., Any]:
    return lambda right: answer


def measuring(distance: float) -> Callable[..., Any]:
    """Return a collision that measures a clearance."""

    def collision(right: Callable[..., Any]) -> Callable[..., Any]:
        def of(world: Any) -> Any:
            names = ("clear", "yaw_matters", "posture_matters", "states_free", "motions_free", "why_blocked")
            answers = {name: getattr(right(world), name) for name in names}
            return SimpleNamespace(**answers, clearance=lambda states: np.full(states.size, distance))

        return of

    return collision


SMALL = (hpop.models.base.Part(((0.0, 0.0),), 0.1, 0.0, 2.0),)
BOX = hpop.world.geometry.solids.Box((0.1, 0.1, 0.1))

MISTAKES = [
    (TWISTS, "rotation of the base in a slide", {"twist": turned_about}),
    (TWISTS, "angular acceleration of the base", {"twist_rate": turned_about}),
    (BODIES, "turned of the base in a slide", {"body": forgetful}),
    (BODIES, "stays of the base is True in a slide, but it moves", {"body": staying}),
    (EXTENT, "the base moves", {"extent": short}),
    (JUDGED, "states are free by collision.., but not by judge", {"collision": kind_to("states_free")}),
    (JUDGED, "motions of the law slide are free by collision", {"collision": kind_to("motions_free")}),
    (JUDGED, "only 0 are free by collision", {"collision": timid}),
    (JUDGED, "of its judge returns '' for a blocked state", {"judge": silent}),
    (CONNECTED, "m or rad from the requested states", {"connect": astray}),
    (CONNECTED, "more than half a turn", {"connect": jumping}),
    (CONNECTED, "yaw is nan at the end of a", {"connect": unfree}),
    (EXECUTED, "the execution begins .* from the plan", {"execution": elsewhere}),
    (EXECUTED, "from a planned state at the time given for passing it", {"execution": unpunctual}),
    (FAULTLESS, "the planned trajectory has no battery", {"faults": grumbling}),
    (LED, "x of a slide at 100%|y of a slide at 100%|yaw of a slide at 100%", {"laws": law(Lagging)}),
    (LED, "yaw halfway through a slide, which is no curve", {"laws": law(Swerving)}),
    (LED, "end of the last phase of a slide", {"laws": law(Halting)}),
    (LED, "phases of a slide must have finite durations >= 0 s, got -", {"laws": law(Backwards)}),
    (
        LED,
        "the law with the key 'glide' must have this kind, got 'slide'",
        {"laws": lambda laws: {"glide": laws["slide"]}},
    ),
    (AXES, "ahead x left of the base", {"pose": lying}),
    (SPACE, "base after a full turn of yaw", {"pose": halved}),
    (PROVIDES, "provides must contain one of base, camera, tool", {"provides": lambda has: has - {"base", "camera"}}),
    (
        PROVIDES,
        "'turn-move', so its laws must include turn and move, got slide, glide",
        {"provides": lambda has: has | {"turn-move"}},
    ),
    (SAYS, "name must be a text that is not empty, got ''", {"name": says("")}),
    (SAYS, r"field_of_view must be \(horizontal, vertical\)", {"field_of_view": says(1.0)}),
    (SAYS, "notes must be a tuple of sentences, got 'sure'", {"notes": says("sure")}),
    (SAYS, "joints must be a tuple of names of states .*, got .'lift'", {"joints": says(("lift",))}),
    (SAYS, r"joints is \(\), but provides contains 'joints'", {"provides": lambda has: has | {"joints"}}),
    (
        SAYS,
        "executed must map 'slide' to one of the laws glide, slide, got 'fly'",
        {"executed": says({"slide": "fly"})},
    ),
    (
        SAYS,
        "'wheels', so wheel_base must be a positive number .*, got None",
        {"provides": lambda has: has | {"wheels"}},
    ),
    (SAYS, "'plane', so platform must hold at least one part, got none", {"platform": says(())}),
    (SAYS, "a part reaches 0.43[0-9]* m from the axis, but the platform only 0.1 m", {"platform": says(SMALL)}),
    (
        SAYS,
        "bodies must be shapes of hpop.world.geometry.solids",
        {"bodies": says(lambda states: [("box", np.eye(4))])},
    ),
    (
        SAYS,
        "the poses of a body must have the shape .*, got .3, 4, 4.",
        {"bodies": says(lambda s: [(BOX, np.ones((3, 4, 4)))])},
    ),
    (SAYS, "clearance of its collision test must return a distance >= 0", {"collision": measuring(-1.0)}),
    (LED, "duration of a slide, which is reversible, on the way back", {"laws": law(Sluggish)}),
    (LED, "extra of a slide must be a tuple of names of states, got 'clock'", {"laws": law(Vague)}),
    (DESCRIBED, "not equal to the original|described as", {}),
]


@dataclass(frozen=True)
class Upright(hpop.PanTilt):
    """A head that says of its tilts that they turn it about the vertical alone."""

    def body(self, name: str, motions: hpop.Motions) -> Any:
        return replace(super().body(name, motions), upright=True)


def test_a_tilt_that_is_said_to_be_none_is_a_mistake() -> None:
    with pytest.raises(ModelError, match="upright of the camera is True in a tilt, but it tilts"):
        check_model(Upright(hpop.DifferentialDrive()))


@pytest.mark.parametrize(("claim", "text", "answers"), MISTAKES, ids=[text for _, text, _ in MISTAKES])
def test_a_mistake_fails_the_check_that_names_it(claim: str, text: str, answers: dict[str, Any]) -> None:
    for check in conformance(Wrong(answers=answers)):
        if check.claim == claim:
            assert re.search(text, check.fault)
            return
        assert check.claim == DESCRIBED or not check.fault  # what is made of its description is no robot of this test
    pytest.fail(f"not looked at: {claim}")


def test_all_faults_are_raised_together() -> None:
    with pytest.raises(ModelError) as raised:
        check_model(Wrong(answers={"laws": law(Halting)}))
    first, *faults = str(raised.value).split("\n  ")
    assert first == "model Wrong fails 2 checks:"
    assert [fault.partition(": ")[0] for fault in faults] == [DESCRIBED, LED]


def test_what_raises_is_a_fault_and_no_crash() -> None:
    def broken(right: Callable[..., Any]) -> Callable[..., Any]:
        return lambda motions: 1 / 0

    faults = {check.claim: check.fault for check in conformance(Wrong(answers={"extent": broken}))}
    assert faults[EXTENT] == "ZeroDivisionError: division by zero"


def test_laws_that_lead_nowhere_end_the_checks() -> None:
    assert [check.claim for check in conformance(Wrong(answers={"laws": law(Halting)}))] == [*CLAIMS[:5]]


@pytest.mark.parametrize(("given", "said"), [(Holonomic, r"Holonomic\(\)"), ("holonomic", r"DifferentialDrive\(\)")])
def test_what_is_no_model_is_said(given: Any, said: str) -> None:
    with pytest.raises(ModelError, match=f"expected an instance of a model, such as {said}"):
        check_model(given)


def fault_of_stations(model: Any) -> str:
    """Return the fault that the check of stations reports, which is not the last check."""
    return next(check.fault for check in conformance(model) if check.claim == STATIONS)


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda found: found._replace(motions={"turn": found.motions["turn"][:1] * 2, "move": found.motions["turn"]}),
         "motions between stations must stay in place, but a move varies x, y"),
        (lambda found: found._replace(headings=found.headings[::-1]), "yaws of stations: expected"),
    ],
)  # fmt: skip
def test_stations_that_no_motion_joins_are_found(change: Callable[[Any], Any], said: str) -> None:
    @dataclass(frozen=True)
    class Astray(hpop.DifferentialDrive):
        def stations(self, yaw: Any) -> Any:
            return change(super().stations(yaw))

    assert said in fault_of_stations(Astray())


@pytest.mark.proof
def test_turns_that_leave_the_head_where_it_was_join_no_stations_with_other_pans() -> None:
    @dataclass(frozen=True)
    class Loose(hpop.PanTilt):
        def stations(self, yaw: Any) -> Any:
            found = super().stations(yaw)
            return found._replace(motions={"turn": found.motions["unwind"]})

    assert "error in pan after a turn in place: expected 0" in fault_of_stations(Loose())
