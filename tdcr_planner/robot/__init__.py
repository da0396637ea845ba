"""The robot: what its TOML file says, as frozen objects and as the arrays that mechanics and planning need."""

from tdcr_planner.robot.backbone import Backbone
from tdcr_planner.robot.body import Body
from tdcr_planner.robot.drive import Drive, DriveTable
from tdcr_planner.robot.features import FEATURES, refuse_unknown
from tdcr_planner.robot.loading import load_robot
from tdcr_planner.robot.paths import PolarPath, SplinePath, TendonPath
from tdcr_planner.robot.segments import Segment
from tdcr_planner.robot.spec import RobotSpec
from tdcr_planner.robot.tendons import Tendon, TendonTable
from tdcr_planner.robot.tip import Camera, Tip
from tdcr_planner.robot.writing import format_robot, write_robot

__all__ = [
    "FEATURES",
    "Backbone",
    "Body",
    "Camera",
    "Drive",
    "DriveTable",
    "PolarPath",
    "RobotSpec",
    "Segment",
    "SplinePath",
    "Tendon",
    "TendonPath",
    "TendonTable",
    "Tip",
    "format_robot",
    "load_robot",
    "refuse_unknown",
    "write_robot",
]
