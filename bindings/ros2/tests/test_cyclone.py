"""Does the node speak with another implementation of DDS?

scripts/robots.sh runs this with Cyclone DDS from PyPI, which knows nothing of ROS: what is on the wire is
what ROS 2 says of it. Also the services that are called with names. The environment is that of
test_node.py.
"""

import csv
import ctypes
import datetime
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
import unittest
from dataclasses import dataclass
from pathlib import Path

DOMAIN = 100 + os.getpid() % 100
# Discovery stays on this machine.
os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>20</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>"
    "</Discovery></Domain></CycloneDDS>"
)

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

CHRONOTOPE = os.environ["CHRONOTOPE"]
CHRONOTOPE_NODE = os.environ["CHRONOTOPE_NODE"]
STREET = Path(os.environ["STREET"])
PATIENCE_S = 30.0


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class ClosestEdges(IdlStruct, typename="topological_navigation_msgs::msg::dds_::ClosestEdges_"):
    edge_ids: sequence[str]
    distances: sequence[float32]


# As rmw_cyclonedds puts a request's identity in front of it.
@dataclass
class SetPlaceRequest(IdlStruct, typename="chronotope_interfaces::srv::dds_::SetPlace_Request_"):
    client: array[uint8, 8]
    sequence: array[uint8, 8]
    place: str


@dataclass
class ChooseRequest(IdlStruct, typename="chronotope_interfaces::srv::dds_::ChooseVisits_Request_"):
    client: array[uint8, 8]
    sequence: array[uint8, 8]
    visits: sequence[str]


@dataclass
class SetPlaceResponse(IdlStruct, typename="chronotope_interfaces::srv::dds_::SetPlace_Response_"):
    client: array[uint8, 8]
    sequence: array[uint8, 8]
    success: bool
    message: str


@dataclass
class ChooseResponse(IdlStruct, typename="chronotope_interfaces::srv::dds_::ChooseVisits_Response_"):
    client: array[uint8, 8]
    sequence: array[uint8, 8]
    success: bool
    message: str


def end_with_us() -> None:
    """A node ends with the tests, however they end."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


LATCHED = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
SENSOR = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5))


class Cyclone(unittest.TestCase):
    def setUp(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.map = self.folder / "street.map"
        self.data = self.folder / "street"
        shutil.copytree(STREET, self.data)
        with (STREET / "index.csv").open() as file:
            self.rows = list(csv.DictReader(file))
        names = sorted({row["place"] for row in self.rows})
        ways = [f"{a},{b}" for a, b in zip(names, names[1:])]
        (self.data / "edges.csv").write_text("\n".join(["from,to", *ways]) + "\n")
        self.run_command("map", "build", "--data", self.data, "--out", self.map)
        self.participant = DomainParticipant(DOMAIN)
        self.errors = self.folder / "errors.txt"

    def run_command(self, *arguments: object) -> str:
        words = [CHRONOTOPE, *map(str, arguments)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=True)
        return done.stdout

    def start(self, *parameters: str) -> None:
        words = [CHRONOTOPE_NODE, "--ros-args", "-p", f"map:={self.map}"]
        for it in parameters:
            words += ["-p", it]
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(DOMAIN),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
        }
        with self.errors.open("w") as errors:
            process = subprocess.Popen(
                words,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                preexec_fn=end_with_us,
            )
        self.addCleanup(process.wait, 10)
        self.addCleanup(process.send_signal, signal.SIGTERM)

    def reader(self, name: str, kind, qos: Qos) -> DataReader:
        return DataReader(self.participant, Topic(self.participant, name, kind, qos=qos), qos=qos)

    def writer(self, name: str, kind, qos: Qos) -> DataWriter:
        return DataWriter(self.participant, Topic(self.participant, name, kind, qos=qos), qos=qos)

    def wait(self, until, each=None):
        end, due = time.monotonic() + PATIENCE_S, 0.0
        while time.monotonic() < end:
            if each is not None and time.monotonic() >= due:
                each()
                due = time.monotonic() + 0.1
            found = until()
            if found:
                return found
            time.sleep(0.01)
        lines = self.errors.read_text().splitlines()
        self.fail("\n".join(lines[-20:]))

    def picture(self, row: dict):
        moment = datetime.datetime.fromisoformat(row["time"].replace("Z", "+00:00"))
        header = Header(Time(int(moment.timestamp()), 0), "camera")
        return header, (STREET / row["path"]).read_bytes()

    def test_images_in_the_place_out(self) -> None:
        self.start("camera_timeout_s:=3600.0")
        current = self.reader("rt/current_node", String, LATCHED)
        self.assertEqual(self.wait(lambda: current.take())[0].data, "none")
        images = self.writer("rt/image", Image, SENSOR)
        for row in self.rows:
            header, file = self.picture(row)
            _, size, _, pixels = file.split(b"\n", 3)
            width, height = map(int, size.split())
            message = Image(header, height, width, "mono8", 0, width, list(pixels))
            end = time.monotonic() + 3.0
            found = self.wait(
                lambda: current.take() or time.monotonic() > end, lambda: images.write(message)
            )
            if found is not True:
                break
        self.assertEqual(found[0].data, row["place"])
        # Whoever comes later is told the same, with the ways from there.
        late = DomainParticipant(DOMAIN)
        topic = Topic(late, "rt/current_node", String, qos=LATCHED)
        reader = DataReader(late, topic, qos=LATCHED)
        self.assertEqual(self.wait(lambda: reader.take())[0].data, row["place"])
        edges = self.reader("rt/closest_edges", ClosestEdges, LATCHED)
        said = self.wait(lambda: [it for it in edges.take() if it.edge_ids])
        self.assertIn(row["place"], said[-1].edge_ids[0])

    def test_packed_images_are_localised(self) -> None:
        self.start("transport:=compressed", "camera_timeout_s:=3600.0")
        images = self.writer("rt/image", CompressedImage, SENSOR)
        answers = self.reader("rt/chronotope_node/localization", String, RELIABLE)
        header, file = self.picture(self.rows[-1])
        message = CompressedImage(header, "pgm", list(file))
        answer = self.wait(lambda: answers.take(), lambda: images.write(message))
        self.assertEqual(json.loads(answer[-1].data)["best"]["place"], self.rows[-1]["place"])

    def call(self, name: str, kinds, words, each=None):
        requests = self.writer(f"rq/chronotope_node/{name}Request", kinds[0], RELIABLE)
        replies = self.reader(f"rr/chronotope_node/{name}Reply", kinds[1], RELIABLE)
        client = list(range(1, 9))
        self.wait(lambda: requests.get_matched_subscriptions(), each)
        self.wait(lambda: replies.get_matched_publications(), each)
        number = [0]

        def ask():
            if each is not None:
                each()

        requests.write(kinds[0](client, [7, 0, 0, 0, 0, 0, 0, 0], words))
        number[0] += 1
        reply = self.wait(lambda: replies.take(), ask)[-1]
        self.assertEqual((list(reply.client), list(reply.sequence)[0]), (client, 7))
        return reply

    def test_you_are_at_the_kitchen_now(self) -> None:
        self.start("learn:=true")
        set_place = ("set_place", (SetPlaceRequest, SetPlaceResponse))
        images = self.writer("rt/image", Image, SENSOR)
        # A picture that the map does not know, taken now.
        header, file = self.picture(self.rows[0])
        _, size, _, pixels = file.split(b"\n", 3)
        width, height = map(int, size.split())
        rows = [pixels[y * width : (y + 1) * width] for y in range(height)]
        upside_down = list(b"".join(reversed(rows)))

        def send():
            stamp = Time(int(time.time()), 0)
            images.write(
                Image(Header(stamp, "camera"), height, width, "mono8", 0, width, upside_down)
            )

        reply = self.call(*set_place, "kitchen", send)
        self.assertTrue(reply.success, reply.message)
        # It is in the file already.
        shown = json.loads(self.run_command("map", "inspect", self.map, "--json"))
        self.assertIn("kitchen", [it["key"] for it in shown["places"]])
        reply = self.call(*set_place, "  ", send)
        self.assertFalse(reply.success)
        self.assertIn("name", reply.message)
        choose = (ChooseRequest, ChooseResponse)
        reply = self.call("accept_visits", choose, ["ffff"])
        self.assertFalse(reply.success)
        self.assertIn("no visit is quarantined", reply.message)

    def test_a_quarantined_visit_is_accepted(self) -> None:
        self.start("learn:=true")
        images = self.writer("rt/image", Image, SENSOR)
        header, file = self.picture(self.rows[0])
        _, size, _, pixels = file.split(b"\n", 3)
        width, height = map(int, size.split())
        # Its stamp is ahead of the robot's clock.
        header.stamp.sec = int(time.time()) + 30 * 86_400
        message = Image(header, height, width, "mono8", 0, width, list(pixels))
        quarantined = lambda: self.run_command("map", "held", self.map)
        due = [0.0]

        def is_held():
            if time.monotonic() < due[0]:
                return ""
            due[0] = time.monotonic() + 0.5
            return quarantined()

        line = self.wait(is_held, lambda: images.write(message))
        before = json.loads(self.run_command("map", "inspect", self.map, "--json"))["num_visits"]
        choose = (ChooseRequest, ChooseResponse)
        reply = self.call("accept_visits", choose, [line.split()[0]])
        self.assertTrue(reply.success, reply.message)
        after = json.loads(self.run_command("map", "inspect", self.map, "--json"))["num_visits"]
        self.assertEqual(after, before + 1)
        self.assertEqual(quarantined(), "")


if __name__ == "__main__":
    unittest.main(verbosity=2)
