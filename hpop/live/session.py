"""Session: the viewers, the robot and its people, and the record; it asks the planner, and tells all viewers.

One viewer drives, the others watch. The robot brakes if the driver's page is silent for :data:`SILENT` s, if the driver
stops it, if a person is in its way, and while the planner is started again.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import compress, repeat
from typing import Any

from hpop.live.messages import WATCHING
from hpop.live.process import PlannerProcess
from hpop.live.record import Record, state_of
from hpop.live.simulator import LiveRobot, ToldPeople
from hpop.live.viewer import Audience, Viewer
from hpop.models.execution import clearance_radius
from hpop.problems.problem import Problem
from hpop.simulation import Pedestrians, Walking
from hpop.trajectories.trajectory import Trajectory

TICK = 0.02  # time between steps of the robot, s
STATE, RECORDED = 0.05, 0.1  # time between messages "state", s; between recorded states, s
SILENT = 0.5  # time, s, without a sign of the driver's page after which the robot brakes
LOST = 5.0
"""Time, s, without a sign after which another viewer may take over, and the robot does not start by itself again."""
RENEWED, RENEWED_BEFORE = 0.4, 0.5  # s: between offers of ways while driving, at least; before the last are too late
RESTS, BEFORE = 2.0, 1.5  # the same as multiples of the duration of the last search for ways, if these are longer
SEEN = 1.5  # least time, s, between two predictions of the people
PREDICTED = 4.0  # time, s, after which people are predicted anew
BEFORE_PEOPLE = 0.15  # distance, m, that the robot keeps from people when it brakes before them
MISSED = "the new way came too late: the robot has passed the place where it begins, and stops"
ELSEWHERE = "people walk elsewhere than when the way was found; it is checked again"
LOOK = "and what was asked last may be lost: look at what is closed, then choose a way"
EXPLORES = 20.0  # s, to wait for the data of the explorer
SETTINGS = {"arrow": True, "tone": False}  # of the announcement of turns, and whether they are on at first


class LiveSession(Audience):
    """One session: a robot, its planner, its people and its viewers.

    problem   of the scenario: map, robot, start and people
    scene     message "scene" (:mod:`hpop.live.scene`), to which the role of each viewer is added
    record    file to which the events are written
    planner   returns the client of the planner's process, given the function that takes the planner's messages
    robot     robot that is driven
    people    people around it
    radii     m, radius of each of them; () if all have that of ``people``
    """

    def __init__(
        self,
        problem: Problem,
        scene: Mapping[str, Any],
        record: Record,
        planner: Callable[[Callable[[dict[str, Any]], None]], PlannerProcess],
        robot: LiveRobot,
        people: Pedestrians,
        radii: Sequence[float] = (),
    ) -> None:
        super().__init__(scene)
        self.problem, self.record, self.record_path = problem, record, record.path
        self.planner = planner(self._planned)
        self.robot, self._pedestrians, self._radii = robot, people, radii
        self._told_people = ToldPeople()
        self.reach = clearance_radius(problem.model, 0.0)
        self.driver: Viewer | None = None
        self.people: list[Walking] = []
        self.radii: list[float] = []  # m, of these people
        self.settings = dict(SETTINGS)
        self.stopped = False
        self._starts = False  # whether a stopped robot drives on once it has the way that was chosen
        self.braked = ""  # why the robot brakes
        self._plan: int | None = None  # number of the present plan among the ways
        self._goal: dict[str, Any] | None = None
        self._closed: dict[str, Any] | None = None  # corners of closed areas by name; None before any change
        self._explored: asyncio.Future[dict[str, Any] | None] | None = None
        self._areas = 0
        self._told_areas: Mapping[str, list[list[float]]] = {}
        self._pushed_at = 0.0
        self._next = {"state": 0.0, "record": 0.0, "ways": 0.0, "people": 0.0}
        self._has_arrived = True
        self._waits = False  # whether a plan was not handed over, as people walk into it
        self._is_planless = False  # whether the planner does not know the plan that the robot would follow
        self._repeats = 0  # how often the destination was asked again without an answer

    async def run(self) -> None:
        """Keep the robot and the planner running until this task is cancelled."""
        self.begin()
        planner = asyncio.create_task(self.planner.run())
        try:
            with self.robot.running():
                while not planner.done():
                    self.step(self.now)
                    await asyncio.sleep(TICK)
            await planner
        finally:
            planner.cancel()
            await asyncio.gather(planner, return_exceptions=True)
            self.record.add(self.now, "end", {})
            self.record.close()

    def step(self, now: float) -> None:
        """Move people and robot on to a time of the session, and tell the viewers."""
        people = self._pedestrians.advance(now, self.robot.base.pose)
        here = [not math.isnan(x) for x, *_ in people]
        self.people = [*compress(people, here)]
        self.radii = [*compress(self._radii or repeat(self._pedestrians.radius), here)]
        self._choose_driver(now)
        braked = self._why_braked(now)
        self.robot.advance(now, brakes=bool(braked))
        if braked != self.braked:
            self.braked = braked
            self.note(f"the robot brakes: {braked}" if braked else "the robot may drive")
        if self.robot.arrived and not self._has_arrived:
            self._has_arrived, self._goal = True, None
            self.tell({"type": "arrived"})
            self._ask("arrived", there=lambda: self._has_arrived and not self._waits)
        if (turn := self.robot.announcement()) is not None:
            self.tell(turn)
        if now >= self._next["state"]:
            self._next["state"] = max(self._next["state"] + STATE, now - STATE)
            for viewer in self.viewers:
                if viewer.greeted:
                    viewer.send(self.state(now))
        if now >= self._next["record"]:
            self._next["record"] = max(self._next["record"] + RECORDED, now - RECORDED)
            self.record.add(now, "state", {k: v for k, v in self.state(now).items() if k not in ("type", "at", "t")})
        self._renew(now)
        self._see_people(now)
        self._see_areas()

    def state(self, now: float) -> dict[str, Any]:
        """Return the message "state": pose, people, index of the present plan among the ways, why the robot brakes."""
        moving, more = not self.robot.stands, {"plan": self._plan, "braked": self.braked}
        return state_of(now, self.robot.pose, self.people, moving=moving, **more)

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer who has gone; another one may then drive."""
        super().leave(viewer)
        self._log("left", viewer, {"why": viewer.gone})
        if viewer is self.driver:
            self.driver = None
            self._choose_driver(self.now)

    def _choose_driver(self, now: float) -> None:
        """Let the next viewer drive who wants to and may, if the driver has left or is silent for long."""
        if self.driver is not None and now - self.driver.alive <= LOST:
            return
        able = (v for v in self.viewers if v.wants and v.may_drive and v is not self.driver and now - v.alive <= SILENT)
        if (following := next(able, None)) is None:
            return
        before, self.driver, self._starts = self.driver, following, False
        self.stopped = not self._has_arrived  # the new driver lets it drive on
        self._log("drives", following, {})
        for viewer in (before, following):
            if viewer is not None and viewer.seen:
                viewer.send(self.scene_for(viewer))

    def scene_for(self, viewer: Viewer) -> dict[str, Any]:
        """Return the message "scene" for a viewer, with its role, the settings and the names of the closed areas."""
        role = "drive" if viewer is self.driver else "watch"
        more = {"settings": self.settings, "explorer": "explore" if viewer.may_drive else ""}
        return {**self.scene, "role": role, "closed": list(self._closed or ()), **more}

    async def explorer(self) -> dict[str, Any] | None:
        """Return the data of the explorer's page for the front of the ways that were offered last; None for none."""
        if self._explored is None or self._explored.done():
            self._explored = asyncio.get_running_loop().create_future()
            self._ask("explore")
        with suppress(TimeoutError):
            return await asyncio.wait_for(asyncio.shield(self._explored), EXPLORES)
        return None

    def tell(self, message: Mapping[str, Any]) -> None:
        """Send a message to all viewers, and record it."""
        self.record.add(self.now, "told", {"message": message})
        super().tell(message)

    def _log(self, event: str, viewer: Viewer, values: Mapping[str, Any]) -> None:
        self.record.add(self.now, event, {"viewer": viewer.number, **values})

    # What viewers say

    def greet(self, viewer: Viewer) -> None:
        """Welcome a viewer, who may become the driver."""
        self._log("hello", viewer, {"drive": viewer.wants, "may_drive": viewer.may_drive})
        self._choose_driver(self.now)
        super().greet(viewer)
        if not self.planner.is_ready:
            viewer.send({"type": "note", "words": "the map is being prepared; this takes some seconds"})

    def act(self, viewer: Viewer, kind: str, values: dict[str, Any]) -> None:
        """Do what a viewer asks for, if it is the one who drives."""
        if viewer is not self.driver and kind not in WATCHING:
            viewer.refuse("another viewer drives; this page watches")
            return
        if kind == "head" and viewer is not self.driver:
            return  # the record holds where the driver looks
        self._log(kind, viewer, values)
        if kind != "head":
            self._act(kind, values, self.now)

    def _act(self, kind: str, values: dict[str, Any], now: float) -> None:
        """Do what the driver asks for."""
        match kind:
            case "stop":
                self.stopped, self._starts = True, False
            case "go" if self._is_planless and not self._has_arrived:
                self.note("the planner does not know the last way any more; choose a way to go on")
            case "go":
                self.stopped = False
            case "setting":
                if values["name"] in self.settings:
                    self.settings[values["name"]] = values["value"]
            case "destination" if self.robot.base.measured is None:
                self.note("the robot does not know where it is; ask again when it does")
            case "destination":
                self._goal = values
                self._see_people(now, wanted=True)
                self._ask("destination", goal=values)
            case "take":
                self._starts = True
                seen = self.newest.get("options", {}).get("asked")
                self._ask("take", **{"asked": seen, **values})
            case "push":
                self._pushed_at, heading = now, self.robot.pose[2] + values["direction"]
                self._ask("push", direction=lambda: heading - self.robot.pose[2])  # the robot may turn meanwhile
            case "wish":
                self._ask("wish", wish=values["wish"])
            case "why":
                self._ask("why", through=values)
            case "close":
                area, name = values.get("corners", values.get("name")), values.get("name", "")
                if "corners" in values and not name:
                    self._areas += 1
                    name = f"area {self._areas}"
                self._ask("close", area=area, name=name)
            case "open":
                self._ask("open", area=values["name"])

    def _ask(self, kind: str, **values: Any) -> None:
        """Ask the planner; time and pose are those at which the request is sent."""
        if not self.planner.is_ready:
            self.note("the planner is not ready yet; please ask again")
            return
        self.planner.ask(kind, now=lambda: self.now, pose=lambda: list(self.robot.pose), **values)

    def _ask_ways(self) -> None:
        """Ask the planner to compute and then to offer the ways from here on."""
        self._ask("options")
        self._ask("show")

    # What the planner says

    def _planned(self, message: dict[str, Any]) -> None:
        """Handle a message of the planner's process: drive its plan, update the session, tell the viewers."""
        match message["type"]:
            case "plan":
                self._follow(message)
            case "ready":
                self._ready()
            case "crashed":
                self.stopped = self.stopped or not self._has_arrived  # the next planner does not know the plan
                self._waits, self._starts, self._told_people, self._is_planless = False, False, ToldPeople(), True
                if self._repeats:
                    self._goal, self._repeats = None, 0
                    self.note("the destination ended the planner twice, and is not asked for again; choose another")
                ended = "did not answer, was ended" if message["hung"] else "has ended by itself"
                self.note(f"the planner {ended} and is started again; the robot stops, {LOOK}")
            case "lost":
                self._leave_plan()
            case "ended":
                self._waits = False
                if not self._has_arrived:  # a push has changed the plan just before the drive ended
                    self.stopped = self._is_planless = True
            case "place" | "options":
                if message["type"] == "options" or message["status"] == "blocked":  # the search for ways has ended
                    self._repeats = 0
                self._plan = message.get("present", self._plan)
                self.tell(message)
            case "pushed":
                self.tell({**message, "milliseconds": round(1000.0 * (self.now - self._pushed_at), 1)})
            case "explorer":
                if self._explored is not None and not self._explored.done():
                    self._explored.set_result(message["payload"])
            case "changed":
                self._closed = message["closed"]
                self.tell({"type": "closed", "names": list(message["closed"])})
            case "taken":
                if message["option"] is not None:
                    self._plan = message["option"]
                if message["by"] == "choice" and self._starts:
                    self.stopped = self._starts = False
                self.tell(message)
                self._ask_ways()
            case "again":
                self._ask_ways()
            case _:
                self.tell(message)

    def _follow(self, message: Mapping[str, Any]) -> None:
        """Let the robot follow the plan of a message "plan", and record it."""
        trajectory = Trajectory.from_description(self.problem.model, message["trajectory"])
        elapsed = message["elapsed"] + self.now - message["now"]
        if self.robot.misses(trajectory, elapsed):
            self._leave_plan(MISSED)
            return
        self._waits = self.robot.approaches(trajectory, elapsed, self.people, self.radii)
        if self._waits:  # the planner is told anew where people are, and then says how the robot goes on
            self._told_people = ToldPeople()
            return
        self.robot.follow(trajectory, elapsed, arrives=message["arrives"])
        self._has_arrived = self._is_planless = False
        self.record.add(self.now, "plan", {name: value for name, value in message.items() if name != "type"})

    def _leave_plan(self, words: str = "the robot has left its plan and stops") -> None:
        """Stop, because the planner does not know what the robot drives: closed areas would not be avoided any more."""
        self.stopped, self._is_planless, self._waits, self._starts = True, True, False, False
        self._ask("arrived", there=lambda: self._is_planless)  # the drive ends, unless a push has changed the plan
        self.note(f"{words}; choose a destination anew")

    def _ready(self) -> None:
        """Tell a planner that has just started what is closed and where to go."""
        self.note("the map is prepared")
        if self._closed is not None:
            self._ask("restore", closed=self._closed)
        if self._goal is not None:
            self._repeats += 1
            self._ask("destination", goal=self._goal)

    def _renew(self, now: float) -> None:
        """Ask for new ways shortly before the robot comes to the place where those of the last offer begin."""
        offer = self.newest.get("options")
        if offer is None or now < self._next["ways"] or self.planner.is_busy or self._has_arrived:
            return
        took, late = self.planner.took, offer["commit"]["t"] - 0.5 * self.robot.braking
        if not self.robot.stands and now > late - max(RENEWED_BEFORE, BEFORE * took):
            self._next["ways"] = now + max(RENEWED, RESTS * took)
            self._ask_ways()

    def _see_people(self, now: float, *, wanted: bool = False) -> None:
        """Tell the planner where the people are if the robot drives, and the prediction is wrong or old.

        wanted  whether to do so also while the robot stands or the planner is busy
        """
        drives = self._waits or not self._has_arrived
        free = drives and not self.planner.is_busy and now >= self._next["people"]
        if self.planner.is_ready and (wanted or free) and self._told_people.differ(self.people, now, PREDICTED):
            self._next["people"] = now + SEEN
            self._told_people.keep(self.people, now)
            self._ask("people", people=self.people, radius=self.radii)
            if drives and not wanted:
                self._ask_ways()

    def _see_areas(self) -> None:
        """Tell the planner which areas are blocked on the map of the robot."""
        areas, told = self.robot.areas, self._told_areas
        if areas == told or not self.planner.is_ready:
            return
        self._told_areas = areas
        for name in told.keys() - areas.keys():
            self._ask("open", area=name)
        for name in areas.keys() - told.keys():
            self._ask("close", area=areas[name], name=name)

    def _why_braked(self, now: float) -> str:
        """Return why the robot must brake, in words; "" if it may drive.

        After `LOST` s of silence the robot counts as stopped, and a viewer has to let it go again.
        """
        driver = self.driver
        if driver is None or now - driver.alive > SILENT:
            if driver is not None and now - driver.alive > LOST:
                self.stopped = True
            return "nobody drives"
        if self.stopped:
            return "stopped"
        if self._waits:
            return ELSEWHERE
        if not self.planner.is_ready:
            return "the planner is being started"
        if self.robot.is_astray and not self._has_arrived and not self._is_planless:
            self._leave_plan()
            return "stopped"
        if trouble := self.robot.trouble():
            self.stopped = self.stopped or (self.robot.is_lost and not self._has_arrived)
            return trouble
        least = [self.reach + radius + BEFORE_PEOPLE for radius in self.radii]
        return "a person is in the way" if not self._has_arrived and self.robot.meets(self.people, least) else ""
