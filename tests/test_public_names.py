"""Public names: those that README, docs/ and examples/ import or mention stay where they are."""

from __future__ import annotations

import pkgutil
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import hpop
from hpop.base.lazy import MOVED

ROOT = Path(__file__).parents[1]
NAMES = """
hpop.arrays.Column
hpop.criteria
hpop.criteria.base.Criterion
hpop.criteria.comfort.sickness
hpop.criteria.convex.ConvexCost
hpop.criteria.others.metrics.zone_fractions
hpop.batch
hpop.ViewModel
hpop.drive.Change
hpop.drive.Commit
hpop.drive.Event
hpop.drive.Execution
hpop.drive.Happening
hpop.drive.Moment
hpop.drive.Option
hpop.drive.Options
hpop.drive.Wish
hpop.drive.load
hpop.drive.performed
hpop.errors.CriterionError
hpop.errors.HpopError
hpop.errors.MapError
hpop.errors.ModelError
hpop.errors.OptionError
hpop.errors.QueryError
hpop.errors.RosError
hpop.errors.UnsupportedCriterion
hpop.examples.copied
hpop.examples.museum
hpop.examples.path
hpop.export.Exported
hpop.export.Frames
hpop.export.export_format
hpop.export.save
hpop.export.write
hpop.front.Point
hpop.frontier.ItemFront
hpop.frontier.FrontError
hpop.frontier.default_reference
hpop.frontier.filter
hpop.frontier.hypervolume
hpop.frontier.knee
hpop.goals.AnyOf
hpop.goals.CameraAt
hpop.goals.Goal
hpop.goals.GoalSet
hpop.goals.Anywhere
hpop.goals.JointsAt
hpop.goals.LookAt
hpop.goals.Region
hpop.goals.ToolAt
hpop.goals.goal
hpop.history.History
hpop.live.record.read_record
hpop.math.hypot
hpop.math.smooth_abs
hpop.models.Ackermann
hpop.models.DifferentialDrive
hpop.models.SerialArm
hpop.models.base.Joint
hpop.models.base.Mount
hpop.models.base.Part
hpop.models.base.PlanarModel
hpop.models.base.plane_space
hpop.models.driven.driven
hpop.models.laws.Move
hpop.models.laws.Run
hpop.models.laws.Spin
hpop.models.laws.Turn
hpop.models.laws.joint_laws
hpop.models.laws.rest_to_rest
hpop.models.speeds.speed_laws
hpop.models.view.Restrictor
hpop.motions.Coupled
hpop.motions.Curve
hpop.motions.JointCollision
hpop.motions.Law
hpop.motions.Leg
hpop.motions.Model
hpop.motions.Motions
hpop.motions.Phase
hpop.motions.StateSpace
hpop.motions.States
hpop.motions.Wheeled
hpop.named_rows.NamedRow
hpop.options
hpop.planners.AnyAngle
hpop.planners.Candidates
hpop.planners.EpsilonConstraint
hpop.planners.Exact
hpop.planners.Lattice
hpop.planners.Planner
hpop.planners.RRT
hpop.planners.Roadmap
hpop.planners.Smoothing
hpop.planners.Spline
hpop.planners.WeightedSum
hpop.planners.WeightedSumCorridor
hpop.planners.base.edge_objectives
hpop.planners.graphs.BuiltGraph
hpop.planners.graphs.CornersGraph
hpop.planners.graphs.GraphFamily
hpop.planners.graphs.LatticeGraph
hpop.planners.graphs.OnGraph
hpop.planners.graphs.RoadmapGraph
hpop.planners.graphs.family.BuiltGraph
hpop.planners.graphs.family.GraphFamily
hpop.planners.graphs.family.OnGraph
hpop.planners.graphs.family.graph_family
hpop.planners.graphs.graph_family
hpop.planners.judgement.judge
hpop.planners.graph_planners.Lattice
hpop.planners.planner
hpop.planners.graph_planners.Roadmap
hpop.poses.poses
hpop.problem.Problem
hpop.randomness
hpop.registry.readers
hpop.ros.Bridge
hpop.ros.Ended
hpop.ros.FollowInterface
hpop.ros.FollowPlanner
hpop.ros.FollowServer
hpop.ros.FollowSettings
hpop.ros.Follower
hpop.ros.GoalPlanner
hpop.ros.Hearing
hpop.ros.Interface
hpop.ros.PathServer
hpop.ros.PlanarPose
hpop.ros.Planned
hpop.ros.Transforms
hpop.ros.path_message
hpop.ros.plain
hpop.ros.planar_pose
hpop.ros.pose_message
hpop.ros.sending.ArmGoal
hpop.ros.sending.outcome
hpop.ros.trajectory_of
hpop.ros.typed
hpop.scenario.load_scenario
hpop.retime
hpop.simulate
hpop.simulation.Command
hpop.simulation.Crowd
hpop.simulation.DriveLimits
hpop.simulation.Pedestrians
hpop.simulation.SimulatedBase
hpop.simulation.Simulation
hpop.simulation.TrackedPeople
hpop.simulation.Tracker
hpop.simulation.farthest_off
hpop.search.Graph
hpop.search.Prepared
hpop.search.pareto_paths
hpop.search.timed.TimedGraph
hpop.search.timed.timed_paths
hpop.status.Progress
hpop.status.Status
hpop.study.Analysis
hpop.study.Answers
hpop.study.Baseline
hpop.study.Best
hpop.study.Checked
hpop.study.Choice
hpop.study.Condition
hpop.study.Design
hpop.study.Fitted
hpop.study.Form
hpop.study.Participant
hpop.study.People
hpop.study.Power
hpop.study.Preference
hpop.study.Prior
hpop.study.Protocol
hpop.study.Withdrawal
hpop.study.analyse
hpop.study.check
hpop.study.fit_criterion
hpop.study.front_digest
hpop.study.pick
hpop.study.power
hpop.study.prepare
hpop.study.preregistration
hpop.study.replace
hpop.study.save_stimuli
hpop.study.score
hpop.study.forms.prorated
hpop.study.session_page
hpop.study.simulate
hpop.study.statistics.Comparison
hpop.study.statistics.Described
hpop.study.statistics.Independent
hpop.study.statistics.Multinomial
hpop.study.statistics.OrdinalFit
hpop.study.statistics.Pair
hpop.study.statistics.Related
hpop.study.statistics.Share
hpop.study.statistics.Strengths
hpop.study.statistics.adjusted
hpop.study.statistics.bradley_terry
hpop.study.statistics.cochran
hpop.study.statistics.describe
hpop.study.statistics.dunn
hpop.study.statistics.friedman
hpop.study.statistics.kruskal
hpop.study.statistics.multinomial
hpop.study.statistics.ordinal_mixed
hpop.study.statistics.share
hpop.study.statistics.wilcoxon
hpop.study.withdraw
hpop.sweep.Sweep
hpop.sweep.dask
hpop.testing.check_criterion
hpop.testing.check_model
hpop.testing.check_planner
hpop.trajectory.Trajectory
hpop.verify
hpop.view.draw_batch
hpop.view.draw_drive
hpop.view.draw_encounters
hpop.view.draw_felt
hpop.view.draw_front
hpop.view.draw_map
hpop.view.draw_preference
hpop.view.draw_side
hpop.view.draw_states
hpop.view.draw_trace
hpop.view.draw_where
hpop.view.save_explorer
hpop.view.render_360
hpop.view.save_360
hpop.view.save_frames
hpop.view.save_pictures
hpop.view.save_arm_page
hpop.view.save_ride
hpop.view.save_video
hpop.view.widget
hpop.world.Box
hpop.world.Cylinder
hpop.world.Future
hpop.world.Ground
hpop.world.Hull
hpop.world.MeasuredField
hpop.world.Person
hpop.world.PlanningProblem
hpop.world.Solid
hpop.world.Sphere
hpop.world.Track
hpop.world.World
hpop.world.bearings
hpop.world.content.Content
hpop.world.content.Landmark
hpop.world.content.Person
hpop.world.content.Zone
hpop.world.field.Field
hpop.world.geojson_content.read
hpop.world.planning_problem
hpop.world.pose_at
hpop.world.predictions
hpop.world.proxemics
hpop.world.readers.read_world
hpop.world.read_tracks
hpop.world.visibility
hpop.base.arrays
hpop.base.arrays.Column
hpop.base.math
hpop.base.math.hypot
hpop.base.math.smooth_abs
hpop.base.randomness
hpop.base.options
hpop.base.registry
hpop.base.registry.GROUPS
hpop.base.registry.criteria
hpop.base.registry.formats
hpop.base.registry.readers
hpop.problems.front.Point
hpop.problems.named_rows.NamedRow
hpop.batches.Results
hpop.batches.summaries
hpop.batches.summary_lines
hpop.problems.verify
hpop.problems.verify.verify
hpop.runtime.limits.Progress
hpop.runtime.limits.Status
hpop.runtime.sweep
hpop.runtime.sweep.Sweep
hpop.runtime.sweep.dask
hpop.trajectories.history.History
hpop.trajectories.poses
hpop.trajectories.poses.poses
hpop.world.content.predictions
hpop.world.content.proxemics
hpop.world.fields.field.Field
hpop.world.read_field
hpop.world.readers.geojson_content
hpop.world.readers.geojson_content.read
hpop.world.readers.readers
hpop.world.sight.bearings
hpop.world.sight.visibility
"""
PUBLIC = [*NAMES.split(), *(f"hpop.{name}" for name in hpop.__all__)]
IMPORTED = re.compile(r"^\s*(?:>>> )?from (hpop[\w.]*) import (\([^)]*\)|[^\n#`]+)", re.MULTILINE)
DOTTED = re.compile(r"\bhpop((?:\.[A-Za-z_]\w*)+)\b")
GROUPS = {
    f"hpop.{kind}" for kind in ("criteria", "formats", "goals", "models", "planners", "readers")
}  # of entry points
PROGRAMS = {"hpop.benchmark"}  # run by `python -m`


def mentioned() -> set[str]:
    """Every name below ``hpop`` in the documents and the examples, as one dotted path."""
    found = set()
    files = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    files += [file for kind in ("*.py", "*.md") for file in (ROOT / "examples").rglob(kind)]
    for file in files:
        text = file.read_text()
        for module, names in IMPORTED.findall(text):
            found |= {f"{module}.{name}" for name in re.findall(r"\w+", re.sub(r"\bas \w+", "", names))}
        found |= {f"hpop{path}" for path in DOTTED.findall(text)}
    return found - GROUPS - PROGRAMS


@pytest.mark.filterwarnings("ignore:.* is .* now:DeprecationWarning")
def test_public_names_are_where_they_were() -> None:
    for name in PUBLIC:
        assert pkgutil.resolve_name(name) is not None, name


def test_a_module_s_former_name_leads_to_it_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    for former, now in MOVED.items():
        monkeypatch.delitem(sys.modules, former, raising=False)
        with pytest.warns(DeprecationWarning, match=f"{former} is {now} now"):
            found = import_module(former)
        replacement = import_module(now)
        public = {name: value for name, value in vars(replacement).items() if not name.startswith("_")}
        assert all(getattr(found, name) is value for name, value in public.items())


@pytest.mark.parametrize(
    ("former", "now"),
    [
        ("hpop.criteria.LookAt", "hpop.criteria.LookAtCriterion"),
        ("hpop.frontier.Front", "hpop.frontier.ItemFront"),
        ("hpop.frontier.Point", "hpop.frontier.ItemPoint"),
        ("hpop.ros.Planning", "hpop.ros.GoalPlanner"),
    ],
)
def test_a_class_s_former_name_leads_to_it_with_a_warning(former: str, now: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"{former} is {now} now"):
        found = pkgutil.resolve_name(former)
    assert found is pkgutil.resolve_name(now)


@pytest.mark.parametrize(
    "name",
    ["batches", "drive", "errors", "export", "frontier", "ros", "scenario", "search", "study", "testing", "view"],
)
def test_a_module_is_there_after_importing_hpop_alone(name: str) -> None:
    assert name in dir(hpop)
    assert hpop.__getattr__(name) is pkgutil.resolve_name(f"hpop.{name}")


def test_documents_and_examples_use_public_names_alone() -> None:
    within = {".".join(name.split(".")[:n]) for name in PUBLIC for n in range(2, name.count(".") + 2)}
    others = {name for name in mentioned() - within if not any(name.startswith(f"{known}.") for known in PUBLIC)}
    assert others == set()
