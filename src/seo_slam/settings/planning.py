"""Settings of the floor's layout and of the planners that find a way over it (DualMap III-A4, IV-A, IV-C)."""

from typing import Literal

from pydantic import Field

from seo_slam.settings.base import Settings


class LayoutSettings(Settings):
    """The scene cloud, and the floor, obstacles, walls and rooms that come out of it."""

    enabled: bool = Field(False, description="keep a scene cloud, from which the abstract map has its layout")
    mode: Literal["background", "inline"] = Field("background", description="background: in a thread of low priority; inline: at once")
    queue: int = Field(4, ge=1, description="frames that wait for the thread; while it is full, frames are passed over")
    move_m: float = Field(1.0, gt=0, description="a frame is taken when the camera has moved so far since the last one taken")
    turn_deg: float = Field(20.0, gt=0, le=180, description="or has turned so far")
    frame_points: int = Field(20000, ge=1, description="about so many pixels of a frame are taken, evenly; DualMap: 19200 of 640x480")
    farthest_m: float = Field(5.0, gt=0, description="pixels with more depth are too noisy to tell floor from obstacle")
    voxel_m: float = Field(0.05, gt=0, description="one point of the scene cloud, the mean, a cube of this side")
    enough_points: int = Field(10, ge=1, description="a cube with so many points is known")
    new_share: float = Field(0.15, ge=0, le=1, description="a frame with fewer of its points in unknown cubes is not kept; 0: all are")
    cell_m: float = Field(0.05, gt=0, description="side of a cell of the layout")
    bin_cells: int = Field(2, ge=1, description="side of a bin of the bird's-eye histogram, in cells. DualMap: bins of 0.1 m")
    wall_percentile: float = Field(90.0, ge=0, lt=100, description="a bin with more points than so many percent of the bins is wall")
    wall_bins: int = Field(5, ge=1, description="a smaller group of joined bins is no wall")
    wall_height_m: float = Field(1.5, gt=0, description="points higher above the floor do not count for walls: a lintel shuts no door")
    wall_fill: float = Field(
        0.7, gt=0, description="a bin with points at so much of the upper half of that height is wall too; above 1: only the paper's rule"
    )
    step_over_m: float = Field(0.05, gt=0, description="what is lower is no obstacle")
    robot_height_m: float = Field(1.5, gt=0, description="what is higher is no obstacle")
    obstacle_points: int = Field(3, ge=1, description="points that an obstacle needs in its cell")
    obstacle_share: float = Field(0.1, ge=0, le=1, description="and so many for each point on the floor of that cell: noise has few")
    obstacle_gap_cells: int = Field(2, ge=0, description="gaps between obstacles are closed up to twice so many cells across")
    floor_points: int = Field(2, ge=1, description="points at the floor's height with which a cell is seen floor")
    floor_gap_cells: int = Field(2, ge=0, description="unseen gaps in seen floor are closed up to twice so many cells across")
    seen_over_m: float = Field(
        0.5, ge=0, description="floor that a look passed over so low counts as seen, without its own points: a camera sees no floor near it"
    )
    seen_over_rays: int = Field(1000, ge=1, description="looks of a frame that are followed for this")
    path_radius_m: float = Field(0.3, ge=0, description="the floor so near under the camera's way was walked on; 0: that tells nothing")
    door_m: float = Field(1.2, gt=0, description="openings narrower than this part rooms")
    room_area_m2: float = Field(2.0, gt=0, description="a smaller part of the floor is no room of its own")
    name_similarity: float = Field(0.55, ge=-1, le=1, description="furniture tells a room from this cosine to a known word on")


class PlannerSettings(Settings):
    """The two planners."""

    radius_m: float = Field(0.18, gt=0, description="of the robot, seen from above")
    comfort_m: float = Field(0.35, gt=0, description="a short cut of the global path keeps so far from everything where the path did")
    rrt_iterations: int = Field(600, ge=1, description="samples of RRT*; all are drawn, and the best way is returned")
    rrt_step_m: float = Field(0.4, gt=0, description="longest edge of its tree")
    rrt_goal_share: float = Field(0.1, ge=0, lt=1, description="of the samples that are the goal itself until it is reached")
    rrt_around_m: float = Field(1.5, gt=0, description="samples are at most so far from the straight line, while that helps")
