"""Criteria (costs to be minimised) in four groups; each is imported and registered when it is first used.

The imports below are the only list of hpop's criteria. The names of this package and the registry are made from it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use
from hpop.criteria.base import Criterion as Criterion
from hpop.criteria.base import criterion as criterion
from hpop.criteria.base import make_criterion as make_criterion
from hpop.criteria.costs import motion_costs as motion_costs
from hpop.criteria.costs import trajectory_cost as trajectory_cost

if TYPE_CHECKING:
    from hpop.criteria.comfort.felt import FeltJerk as FeltJerk
    from hpop.criteria.comfort.felt import FeltMSDV as FeltMSDV
    from hpop.criteria.comfort.felt import LateralLoad as LateralLoad
    from hpop.criteria.comfort.felt import RideComfort as RideComfort
    from hpop.criteria.comfort.felt import RideSickness as RideSickness
    from hpop.criteria.comfort.felt import VibrationDose as VibrationDose
    from hpop.criteria.comfort.motion import CameraLength as CameraLength
    from hpop.criteria.comfort.motion import FeltAcceleration as FeltAcceleration
    from hpop.criteria.comfort.motion import HeadingMismatch as HeadingMismatch
    from hpop.criteria.comfort.motion import Jerk as Jerk
    from hpop.criteria.comfort.motion import Length as Length
    from hpop.criteria.comfort.motion import MeanHeadingMismatch as MeanHeadingMismatch
    from hpop.criteria.comfort.motion import SpeedChanges as SpeedChanges
    from hpop.criteria.comfort.motion import SquaredAcceleration as SquaredAcceleration
    from hpop.criteria.comfort.optic_flow import OpticFlow as OpticFlow
    from hpop.criteria.comfort.optic_flow import PassingDistance as PassingDistance
    from hpop.criteria.comfort.optic_flow import PeakOpticFlow as PeakOpticFlow
    from hpop.criteria.comfort.rotation import AngularAcceleration as AngularAcceleration
    from hpop.criteria.comfort.rotation import CameraRoll as CameraRoll
    from hpop.criteria.comfort.rotation import LongestTurn as LongestTurn
    from hpop.criteria.comfort.rotation import NetWinding as NetWinding
    from hpop.criteria.comfort.rotation import Rotation as Rotation
    from hpop.criteria.comfort.rotation import RotationTime as RotationTime
    from hpop.criteria.comfort.rotation import Turns as Turns
    from hpop.criteria.comfort.rotation import UnforeseenTurns as UnforeseenTurns
    from hpop.criteria.comfort.sickness import MSDV as MSDV
    from hpop.criteria.comfort.sickness import Sickness as Sickness
    from hpop.criteria.learnt import Learnt as Learnt
    from hpop.criteria.others.encounters import ExpectedContacts as ExpectedContacts
    from hpop.criteria.others.encounters import SocialForce as SocialForce
    from hpop.criteria.others.encounters import TimeToCollision as TimeToCollision
    from hpop.criteria.others.encounters import VisibilityToPeople as VisibilityToPeople
    from hpop.criteria.others.encounters import WorstIntrusion as WorstIntrusion
    from hpop.criteria.others.personal_space import CuttingBetween as CuttingBetween
    from hpop.criteria.others.personal_space import HallZones as HallZones
    from hpop.criteria.others.personal_space import OSpace as OSpace
    from hpop.criteria.others.personal_space import PersonalSpace as PersonalSpace
    from hpop.criteria.others.zones import AgainstFlow as AgainstFlow
    from hpop.criteria.others.zones import Speeding as Speeding
    from hpop.criteria.performance.fields import FieldExposure as FieldExposure
    from hpop.criteria.performance.fields import FieldWorst as FieldWorst
    from hpop.criteria.performance.fields import StaleView as StaleView
    from hpop.criteria.performance.fields import TimeBelow as TimeBelow
    from hpop.criteria.performance.landmarks import LandmarkBlindness as LandmarkBlindness
    from hpop.criteria.performance.landmarks import LandmarkVisibility as LandmarkVisibility
    from hpop.criteria.performance.landmarks import StopsMissed as StopsMissed
    from hpop.criteria.performance.landmarks import UnseenLandmarks as UnseenLandmarks
    from hpop.criteria.performance.orientation import HandEyeMisalignment as HandEyeMisalignment
    from hpop.criteria.performance.orientation import NetMisalignment as NetMisalignment
    from hpop.criteria.performance.orientation import OrientationRetention as OrientationRetention
    from hpop.criteria.performance.surroundings import Enclosure as Enclosure
    from hpop.criteria.performance.surroundings import Exposure as Exposure
    from hpop.criteria.performance.surroundings import Obstruction as Obstruction
    from hpop.criteria.performance.surroundings import Openness as Openness
    from hpop.criteria.performance.surroundings import WorstObstruction as WorstObstruction
    from hpop.criteria.performance.targets import LookAtCriterion as LookAtCriterion
    from hpop.criteria.performance.targets import Occlusion as Occlusion
    from hpop.criteria.performance.targets import ViewDistance as ViewDistance
    from hpop.criteria.robot import BendingEnergy as BendingEnergy
    from hpop.criteria.robot import Clearance as Clearance
    from hpop.criteria.robot import CurvatureSignChanges as CurvatureSignChanges
    from hpop.criteria.robot import Duration as Duration
    from hpop.criteria.robot import Energy as Energy
    from hpop.criteria.robot import Proximity as Proximity
    from hpop.criteria.robot import Smoothness as Smoothness
    from hpop.criteria.robot.joints import JointEnergy as JointEnergy
    from hpop.criteria.robot.joints import JointLength as JointLength
    from hpop.criteria.robot.joints import JointLimits as JointLimits
    from hpop.criteria.robot.joints import Singularity as Singularity

_HOMES = homes_of(__name__)
__all__ = [*_HOMES, "Criterion", "criterion", "make_criterion", "motion_costs", "trajectory_cost"]
__getattr__ = on_first_use(__name__, _HOMES, former={"LookAt": "LookAtCriterion"})
