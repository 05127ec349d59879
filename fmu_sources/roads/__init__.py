"""Roads under the wheels, and the speed at which they are driven.

- `layout`: where the wheels are, what is previewed and scanned
- `road`: a road by formula: profile, heights, slopes, rates, preview
- `height_table`: a road by a table of heights
- `standard`: sine and curb (paper 000)
- `perryman3`: synthetic stand-in for the Perryman 3 course (paper 000)
- `hole_bump`: hole, flat and bump (paper 004)
- `bumps`: test track of speed bumps (paper 001)
- `iso8608`: random roads of ISO 8608, and off-road terrain
- `rms_course`: profiles with the rms and spectrum of measured courses
- `half_round`: half-round obstacle as a wheel rolls over it
- `half_cylinder`: half-round obstacle as it is, for tires that envelop it
- `proving_ground`: RMS courses and half-round under one car
- `random_road`: random roads with class, seed and length as parameters
- `enveloping`: what the center of a rolling wheel follows
- `shallow_trench`: shallow trench under the 6x6 (paper 003)
- `bench`: motion of the bench's plate over time (paper 002)
- `user_file`: a road from a user's file
- `opencrg`: OpenCRG files
- `speed_command`: speed that follows a command, with the distance
- `speed_profile`: constant speed or a ramp, with the distance
- `errors`: what is wrong with a road
"""

from fmu_sources.roads.bumps import road_bumps
from fmu_sources.roads.errors import RoadError
from fmu_sources.roads.half_cylinder import road_half_round
from fmu_sources.roads.height_table import HeightTable, road_from_table
from fmu_sources.roads.hole_bump import road_hole_bump
from fmu_sources.roads.iso8608 import iso8608_table, road_iso8608, road_offroad
from fmu_sources.roads.layout import ENVELOPING, RoadLayout, RoadScan, WheelPosition
from fmu_sources.roads.perryman3 import perryman3_table, road_perryman3
from fmu_sources.roads.proving_ground import road_proving_ground
from fmu_sources.roads.random_road import road_random
from fmu_sources.roads.road import Profile, Shape, road
from fmu_sources.roads.shallow_trench import road_shallow_trench
from fmu_sources.roads.speed_command import speed_command
from fmu_sources.roads.speed_profile import speed_profile
from fmu_sources.roads.standard import road_curb, road_sine
from fmu_sources.roads.user_file import road_from_file

__all__ = [
    "ENVELOPING",
    "HeightTable",
    "Profile",
    "RoadError",
    "RoadLayout",
    "RoadScan",
    "Shape",
    "WheelPosition",
    "iso8608_table",
    "perryman3_table",
    "road",
    "road_bumps",
    "road_curb",
    "road_from_file",
    "road_from_table",
    "road_half_round",
    "road_hole_bump",
    "road_iso8608",
    "road_offroad",
    "road_perryman3",
    "road_proving_ground",
    "road_random",
    "road_shallow_trench",
    "road_sine",
    "speed_command",
    "speed_profile",
]
