"""A bowing machine's sensor: plays a recording to /bridge_force, in blocks of 20 ms, at the rate of its samples.

    python tests/support/player.py FILE.npy RATE

It begins when somebody listens, and ends when it has played.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import Float32MultiArray

BLOCKS_A_SECOND = 50
PATIENCE_S = 60


def main() -> None:
    wave, rate = np.load(sys.argv[1]).astype(np.float32), int(sys.argv[2])
    rclpy.init()
    node = rclpy.create_node("sensor")
    publisher = node.create_publisher(Float32MultiArray, "/bridge_force", QoSProfile(depth=1000))
    deadline = time.monotonic() + PATIENCE_S
    while not publisher.get_subscription_count():
        assert time.monotonic() < deadline, "nobody listens"
        time.sleep(0.05)
    began, length = time.monotonic(), rate // BLOCKS_A_SECOND
    for first in range(0, len(wave), length):
        publisher.publish(Float32MultiArray(data=wave[first : first + length].tolist()))
        time.sleep(max(0.0, began + (first + length) / rate - time.monotonic()))
    publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=PATIENCE_S))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
