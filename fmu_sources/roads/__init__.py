"""Roads under the wheels, and the speed at which they are driven."""

from fmu_sources.roads.layout import RoadLayout, WheelPosition
from fmu_sources.roads.road import Profile, road
from fmu_sources.roads.speed_profile import speed_profile
from fmu_sources.roads.standard import road_curb, road_sine

__all__ = ["Profile", "RoadLayout", "WheelPosition", "road", "road_curb", "road_sine", "speed_profile"]
