"""Starts chronotope_node for a camera: ros2 launch ./chronotope.launch.py map:=site.map camera:=/camera/image_raw

The node is an ordinary program (cargo install --locked --path bindings/ros2), so it needs no package.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

ARGUMENTS = [
    ("map", "site.map", "The map's file."),
    ("camera", "/camera/image_raw", "The topic of the images."),
    ("transport", "raw", "raw: sensor_msgs/msg/Image; compressed: CompressedImage."),
    ("learn", "false", "Whether visits are learnt into the map."),
    ("track", "true", "Whether what was believed before counts, too."),
    ("autostart", "true", "Whether it answers at once; else a lifecycle manager configures and activates it."),
    ("use_sim_time", "false", "Whether the clock is /clock."),
    ("namespace", "/", "Of the node and of its topics."),
]


def generate_launch_description() -> LaunchDescription:
    words = ["chronotope_node", "--ros-args", "-r", ["__ns:=", LaunchConfiguration("namespace")]]
    words += ["-r", ["image:=", LaunchConfiguration("camera")]]
    for name in ["map", "transport", "learn", "track", "autostart", "use_sim_time"]:
        words += ["-p", [f"{name}:=", LaunchConfiguration(name)]]
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text)
        for name, value, text in ARGUMENTS
    ]
    # A map that is not there yet is looked for again.
    node = ExecuteProcess(
        cmd=words, output="screen", sigterm_timeout="5", respawn=True, respawn_delay=2.0
    )
    return LaunchDescription([*declared, node])
