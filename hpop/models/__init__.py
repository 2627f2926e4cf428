"""Robot models; importing this package registers those that come with hpop."""

from hpop.models.ackermann import Ackermann
from hpop.models.differential_drive import DifferentialDrive
from hpop.models.mobile_arm import MobileArm
from hpop.models.pan_tilt import PanTilt
from hpop.models.serial_arm import SerialArm
from hpop.models.two_arms import TwoArms
from hpop.models.view import ViewModel

__all__ = ["Ackermann", "DifferentialDrive", "MobileArm", "PanTilt", "SerialArm", "TwoArms", "ViewModel"]
