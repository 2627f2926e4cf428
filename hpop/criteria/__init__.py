"""Criteria in four groups. Each is imported when it is first used, and then registered."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.criteria.base import Criterion, criterion, make_criterion, motion_costs, trajectory_cost
from hpop.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.criteria.comfort.angular_acceleration import AngularAcceleration
    from hpop.criteria.comfort.camera_length import CameraLength
    from hpop.criteria.comfort.camera_roll import CameraRoll
    from hpop.criteria.comfort.heading_mismatch import HeadingMismatch, MeanHeadingMismatch
    from hpop.criteria.comfort.jerk import Jerk
    from hpop.criteria.comfort.length import Length
    from hpop.criteria.comfort.msdv import MSDV
    from hpop.criteria.comfort.net_winding import NetWinding
    from hpop.criteria.comfort.optic_flow import OpticFlow, PeakOpticFlow
    from hpop.criteria.comfort.passing_distance import PassingDistance
    from hpop.criteria.comfort.rotation import Rotation
    from hpop.criteria.comfort.rotation_time import RotationTime
    from hpop.criteria.comfort.sickness import Sickness
    from hpop.criteria.comfort.turns import Turns
    from hpop.criteria.learnt import Learnt
    from hpop.criteria.others.against_flow import AgainstFlow
    from hpop.criteria.others.cutting_between import CuttingBetween
    from hpop.criteria.others.hall_zones import HallZones
    from hpop.criteria.others.intrusion import ExpectedContacts, WorstIntrusion
    from hpop.criteria.others.o_space import OSpace
    from hpop.criteria.others.personal_space import PersonalSpace
    from hpop.criteria.others.social_force import SocialForce
    from hpop.criteria.others.speeding import Speeding
    from hpop.criteria.others.time_to_collision import TimeToCollision
    from hpop.criteria.others.visibility_to_people import VisibilityToPeople
    from hpop.criteria.performance.hand_eye_misalignment import HandEyeMisalignment
    from hpop.criteria.performance.landmark_visibility import LandmarkBlindness, LandmarkVisibility
    from hpop.criteria.performance.look_at import LookAt
    from hpop.criteria.performance.obstruction import Exposure, Obstruction, WorstObstruction
    from hpop.criteria.performance.occlusion import Occlusion
    from hpop.criteria.performance.openness import Enclosure, Openness
    from hpop.criteria.performance.orientation_retention import NetMisalignment, OrientationRetention
    from hpop.criteria.performance.unseen_landmarks import UnseenLandmarks
    from hpop.criteria.performance.view_distance import ViewDistance
    from hpop.criteria.robot.bending_energy import BendingEnergy
    from hpop.criteria.robot.clearance import Clearance
    from hpop.criteria.robot.curvature_sign_changes import CurvatureSignChanges
    from hpop.criteria.robot.duration import Duration
    from hpop.criteria.robot.energy import Energy
    from hpop.criteria.robot.joint_energy import JointEnergy
    from hpop.criteria.robot.joint_length import JointLength
    from hpop.criteria.robot.joint_limits import JointLimits
    from hpop.criteria.robot.proximity import Proximity
    from hpop.criteria.robot.singularity import Singularity
    from hpop.criteria.robot.smoothness import Smoothness

_HOMES = {
    "AgainstFlow": "hpop.criteria.others.against_flow",
    "AngularAcceleration": "hpop.criteria.comfort.angular_acceleration",
    "BendingEnergy": "hpop.criteria.robot.bending_energy",
    "CameraLength": "hpop.criteria.comfort.camera_length",
    "CameraRoll": "hpop.criteria.comfort.camera_roll",
    "Clearance": "hpop.criteria.robot.clearance",
    "CurvatureSignChanges": "hpop.criteria.robot.curvature_sign_changes",
    "CuttingBetween": "hpop.criteria.others.cutting_between",
    "Duration": "hpop.criteria.robot.duration",
    "Enclosure": "hpop.criteria.performance.openness",
    "Energy": "hpop.criteria.robot.energy",
    "ExpectedContacts": "hpop.criteria.others.intrusion",
    "Exposure": "hpop.criteria.performance.obstruction",
    "HallZones": "hpop.criteria.others.hall_zones",
    "HandEyeMisalignment": "hpop.criteria.performance.hand_eye_misalignment",
    "HeadingMismatch": "hpop.criteria.comfort.heading_mismatch",
    "Jerk": "hpop.criteria.comfort.jerk",
    "JointEnergy": "hpop.criteria.robot.joint_energy",
    "JointLength": "hpop.criteria.robot.joint_length",
    "JointLimits": "hpop.criteria.robot.joint_limits",
    "LandmarkBlindness": "hpop.criteria.performance.landmark_visibility",
    "LandmarkVisibility": "hpop.criteria.performance.landmark_visibility",
    "Learnt": "hpop.criteria.learnt",
    "Length": "hpop.criteria.comfort.length",
    "LookAt": "hpop.criteria.performance.look_at",
    "MSDV": "hpop.criteria.comfort.msdv",
    "MeanHeadingMismatch": "hpop.criteria.comfort.heading_mismatch",
    "NetMisalignment": "hpop.criteria.performance.orientation_retention",
    "NetWinding": "hpop.criteria.comfort.net_winding",
    "OSpace": "hpop.criteria.others.o_space",
    "Obstruction": "hpop.criteria.performance.obstruction",
    "Openness": "hpop.criteria.performance.openness",
    "Occlusion": "hpop.criteria.performance.occlusion",
    "OpticFlow": "hpop.criteria.comfort.optic_flow",
    "OrientationRetention": "hpop.criteria.performance.orientation_retention",
    "PassingDistance": "hpop.criteria.comfort.passing_distance",
    "PeakOpticFlow": "hpop.criteria.comfort.optic_flow",
    "PersonalSpace": "hpop.criteria.others.personal_space",
    "Proximity": "hpop.criteria.robot.proximity",
    "Rotation": "hpop.criteria.comfort.rotation",
    "RotationTime": "hpop.criteria.comfort.rotation_time",
    "Sickness": "hpop.criteria.comfort.sickness",
    "Singularity": "hpop.criteria.robot.singularity",
    "Smoothness": "hpop.criteria.robot.smoothness",
    "SocialForce": "hpop.criteria.others.social_force",
    "Speeding": "hpop.criteria.others.speeding",
    "TimeToCollision": "hpop.criteria.others.time_to_collision",
    "Turns": "hpop.criteria.comfort.turns",
    "UnseenLandmarks": "hpop.criteria.performance.unseen_landmarks",
    "ViewDistance": "hpop.criteria.performance.view_distance",
    "VisibilityToPeople": "hpop.criteria.others.visibility_to_people",
    "WorstIntrusion": "hpop.criteria.others.intrusion",
    "WorstObstruction": "hpop.criteria.performance.obstruction",
}

__all__ = [
    "MSDV",
    "AgainstFlow",
    "AngularAcceleration",
    "BendingEnergy",
    "CameraLength",
    "CameraRoll",
    "Clearance",
    "Criterion",
    "CurvatureSignChanges",
    "CuttingBetween",
    "Duration",
    "Enclosure",
    "Energy",
    "ExpectedContacts",
    "Exposure",
    "HallZones",
    "HandEyeMisalignment",
    "HeadingMismatch",
    "Jerk",
    "JointEnergy",
    "JointLength",
    "JointLimits",
    "LandmarkBlindness",
    "LandmarkVisibility",
    "Learnt",
    "Length",
    "LookAt",
    "MeanHeadingMismatch",
    "NetMisalignment",
    "NetWinding",
    "OSpace",
    "Obstruction",
    "Occlusion",
    "Openness",
    "OpticFlow",
    "OrientationRetention",
    "PassingDistance",
    "PeakOpticFlow",
    "PersonalSpace",
    "Proximity",
    "Rotation",
    "RotationTime",
    "Sickness",
    "Singularity",
    "Smoothness",
    "SocialForce",
    "Speeding",
    "TimeToCollision",
    "Turns",
    "UnseenLandmarks",
    "ViewDistance",
    "VisibilityToPeople",
    "WorstIntrusion",
    "WorstObstruction",
    "criterion",
    "make_criterion",
    "motion_costs",
    "trajectory_cost",
]

__getattr__ = on_first_use(__name__, _HOMES)
