"""Are bags that others write read like folders, and ours by others?

scripts/robots.sh runs this with the packages of requirements.txt. The environment names the commands
and a folder that the example render_street has drawn:

    CHRONOTOPE, CHRONOTOPE_BAGS, STREET
"""

from __future__ import annotations

import csv
import datetime
import hashlib
import json
import math
import os
import shutil
import struct
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
)
from rosbags.rosbag2 import (
    Writer as RosbagsWriter,
)
from rosbags.typesys import Stores, get_typestore

CHRONOTOPE = os.environ["CHRONOTOPE"]
CHRONOTOPE_BAGS = os.environ["CHRONOTOPE_BAGS"]
STREET = Path(os.environ["STREET"])
TOPIC = "/camera/image"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
RAW, PACKED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def run(command: str, *arguments: object, codes=(0,)) -> subprocess.CompletedProcess:
    words = [command, *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode in codes, f"{words}: {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def bags(*arguments: object, codes=(0,)) -> subprocess.CompletedProcess:
    return run(CHRONOTOPE_BAGS, *arguments, codes=codes)


class Picture:
    """One row of the street's index."""

    def __init__(self, path: str, place: str, time: str) -> None:
        self.place = place
        moment = datetime.datetime.fromisoformat(time.replace("Z", "+00:00"))
        self.ns = int(moment.timestamp()) * 10**9
        self.file = (STREET / path).read_bytes()
        magic, size, most, pixels = self.file.split(b"\n", 3)
        assert (magic, most) == (b"P5", b"255")
        width, height = map(int, size.split())
        self.gray = np.frombuffer(pixels, np.uint8).reshape(height, width)

    def header(self):
        stamp = TYPES.types["builtin_interfaces/msg/Time"](self.ns // 10**9, self.ns % 10**9)
        return TYPES.types["std_msgs/msg/Header"](stamp, "camera")

    def message(self, encoding: str | None):
        """An Image in an encoding, or a CompressedImage."""
        if encoding is None:
            return TYPES.types[PACKED](self.header(), "pgm", np.frombuffer(self.file, np.uint8))
        height, width = self.gray.shape
        if encoding == "mono8":
            # Rows with padding behind them.
            rows = np.pad(self.gray, ((0, 0), (0, 7)))
        elif encoding == "bgr8":
            rows = np.repeat(self.gray, 3, axis=1)
        else:
            rows = (self.gray.astype(np.uint16) << 8).view(np.uint8)
        data = rows.reshape(-1)
        return TYPES.types[RAW](self.header(), height, width, encoding, 0, rows.shape[1], data)


def street() -> list[Picture]:
    with (STREET / "index.csv").open() as file:
        return [Picture(row["path"], row["place"], row["time"]) for row in csv.DictReader(file)]


def type_of(encoding: str | None) -> str:
    return PACKED if encoding is None else RAW


def write_rosbags(folder: Path, messages, storage, compression=None) -> None:
    """`messages`: topic, type, ns, message."""
    writer = RosbagsWriter(folder, version=9, storage_plugin=storage)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], ns, TYPES.serialize_cdr(message, kind))


def write_mcap(path: Path, messages, compression: CompressionType, chunk_size=200_000) -> None:
    with path.open("wb") as file:
        writer = Ros2Writer(file, compression=compression, chunk_size=chunk_size)
        schemas = {}
        for topic, kind, ns, message in messages:
            if kind not in schemas:
                text, _ = TYPES.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, text)
            # Its arrays are bytes.
            fields = vars(message) | {"data": message.data.tobytes()}
            writer.write_message(topic, schemas[kind], fields, ns, ns)
        writer.finish()


def images(pictures: list[Picture], encoding: str | None):
    return [(TOPIC, type_of(encoding), it.ns, it.message(encoding)) for it in pictures]


def write_places(path: Path, pictures: list[Picture]) -> None:
    rows = [f"{it.ns}ns,{it.ns + 10**9}ns,{it.place}" for it in pictures]
    path.write_text("\n".join(["begin,end,place", *rows]) + "\n")


def digest(map_file: Path) -> str:
    """Of the map's canonical export."""
    folder = map_file.with_suffix(".export")
    shutil.rmtree(folder, ignore_errors=True)
    run(CHRONOTOPE, "map", "export", map_file, folder, "--canonical")
    total = hashlib.sha256()
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            total.update(str(file.relative_to(folder)).encode() + file.read_bytes())
    shutil.rmtree(folder)
    return total.hexdigest()


def places_of(map_file: Path) -> list:
    """Names, visits and features: the digest also says how the images were changed."""
    shown = json.loads(run(CHRONOTOPE, "map", "inspect", map_file, "--json").stdout)
    return [(it["key"], it["num_visits"], it["num_features"]) for it in shown["places"]]


class Bags(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.pictures = street()
        cls.folder = Path(tempfile.mkdtemp())
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.places = cls.folder / "places.csv"
        write_places(cls.places, cls.pictures)
        cls.map = cls.folder / "folder.map"
        run(CHRONOTOPE, "map", "build", "--data", STREET, "--out", cls.map)
        cls.expected = digest(cls.map)
        cls.bag = cls.folder / "plain" / "street.mcap"
        cls.bag.parent.mkdir()
        write_mcap(cls.bag, images(cls.pictures, None), CompressionType.ZSTD)

    def new_folder(self) -> Path:
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        self.addCleanup(shutil.rmtree, folder)
        return folder

    def check_same_map(self, bag: Path) -> None:
        out = self.new_folder() / "bag.map"
        bags("build", bag, "--out", out, "--topic", TOPIC, "--places", f"csv:{self.places}")
        self.assertEqual(digest(out), self.expected, bag)

    def test_rosbags_gives_the_map_of_the_folder(self) -> None:
        log, database = StoragePlugin.MCAP, StoragePlugin.SQLITE3
        for encoding, storage, compression in [
            (None, log, None),
            ("mono8", log, CompressionMode.STORAGE),
            ("bgr8", database, None),
            (None, database, CompressionMode.FILE),
            ("mono16", database, CompressionMode.MESSAGE),
        ]:
            with self.subTest(encoding=encoding, storage=storage, compression=compression):
                bag = self.new_folder() / "street"
                write_rosbags(bag, images(self.pictures, encoding), storage, compression)
                self.check_same_map(bag)

    def test_mcap_ros2_gives_the_map_of_the_folder(self) -> None:
        for encoding, compression in [
            (None, CompressionType.ZSTD),
            ("bgr8", CompressionType.LZ4),
            ("mono8", CompressionType.NONE),
        ]:
            with self.subTest(encoding=encoding, compression=compression):
                bag = self.new_folder() / "street.mcap"
                write_mcap(bag, images(self.pictures, encoding), compression)
                self.check_same_map(bag)

    def test_a_split_bag_is_one_bag(self) -> None:
        folder = self.new_folder() / "street"
        folder.mkdir()
        messages = images(self.pictures, None)
        names = []
        for number in range(3):
            names.append(f"street_{number}.mcap")
            part = messages[number * 8 : number * 8 + 8]
            write_mcap(folder / names[-1], part, CompressionType.ZSTD)
        listed = "".join(f"  - {name}\n" for name in names)
        (folder / "metadata.yaml").write_text(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n"
            f"  relative_file_paths:\n{listed}  compression_format: ''\n  compression_mode: ''\n"
        )
        self.check_same_map(folder)
        # As a recorder leaves it that was killed.
        (folder / "metadata.yaml").unlink()
        done = bags("check", folder, codes=(1,))
        self.assertIn("metadata.yaml: it is missing", done.stdout)
        self.assertIn("24 listed, 24 readable", done.stdout)

    def test_turned_images_are_turned_back(self) -> None:
        bag = self.new_folder() / "street.mcap"
        turned = images(self.pictures, "mono8")
        for _, _, _, message in turned:
            rows = message.data.reshape(message.height, message.step)[:, : message.width]
            message.data, message.step = rows[::-1, ::-1].reshape(-1), message.width
        write_mcap(bag, turned, CompressionType.ZSTD)
        out = self.new_folder() / "bag.map"
        given = [bag, "--places", f"csv:{self.places}", "--rotate", 180]
        bags("build", *given, "--out", out)
        self.assertEqual(places_of(out), places_of(self.map))
        lines = bags("localize", self.map, bag, "--rotate", 180, "--json", codes=(0, 1)).stdout
        straight = bags("localize", self.map, self.bag, "--json", codes=(0, 1)).stdout
        places = [[json.loads(it)["place"] for it in text.splitlines()] for text in (lines, straight)]
        self.assertEqual(*places)
        self.assertGreaterEqual(sum(it is not None for it in places[0]), 18)
        # What was predicted is drawn where it is in the recorded, upside-down image.
        drawn = []
        for name, rotated, source in [("a", [], self.bag), ("b", ["--rotate", 180], bag)]:
            answers = self.new_folder() / f"{name}.mcap"
            bags("localize", self.map, source, "--out", answers, *rotated, codes=(0, 1))
            with answers.open("rb") as file:
                drawn.append(
                    [
                        [(it["x"], it["y"]) for kind in json.loads(m.data)["points"] for it in kind["points"]]
                        for _, channel, m in make_reader(file).iter_messages()
                        if channel.topic == "/chronotope/annotations"
                    ]
                )
        height, width = self.pictures[0].gray.shape
        self.assertGreater(sum(map(len, drawn[0])), 100)
        for ours, theirs in zip(*drawn, strict=True):
            for (x, y), (u, v) in zip(ours, theirs, strict=True):
                self.assertAlmostEqual(x, width - 1 - u, places=2)
                self.assertAlmostEqual(y, height - 1 - v, places=2)

    def test_what_is_masked_is_not_used(self) -> None:
        """As a manifest masks the same images in a folder."""
        height, width = self.pictures[0].gray.shape
        folder = self.new_folder()
        mask = np.full((height, width), 255, np.uint8)
        mask[:, : width // 2] = 0
        file = folder / "mask.pgm"
        file.write_bytes(b"P5\n%d %d\n255\n" % (width, height) + mask.tobytes())
        data = folder / "street"
        shutil.copytree(STREET, data)
        (data / "dataset.toml").write_text(
            'name = "street"\n[time]\nclock = "real"\n'
            f"[[mask]]\nx = 0\ny = 0\nwidth = {width // 2}\nheight = {height}\n"
        )
        run(CHRONOTOPE, "map", "build", "--data", data, "--out", folder / "folder.map")
        given = [self.bag, "--places", f"csv:{self.places}", "--mask", file]
        bags("build", *given, "--out", folder / "bag.map")
        self.assertEqual(places_of(folder / "bag.map"), places_of(folder / "folder.map"))
        self.assertNotEqual(places_of(folder / "bag.map"), places_of(self.map))
        done = bags("localize", folder / "bag.map", self.bag, "--mask", file, codes=(0, 1))
        self.assertEqual(len(done.stdout.splitlines()), len(self.pictures))
        mask = np.full((height // 2, width), 255, np.uint8)
        file.write_bytes(b"P5\n%d %d\n255\n" % (width, height // 2) + mask.tobytes())
        done = bags("localize", self.map, self.bag, "--mask", file, codes=(2,))
        self.assertIn("mask", done.stderr)

    def test_numbers_come_from_a_configuration(self) -> None:
        folder = self.new_folder()
        numbers = folder / "numbers.toml"
        numbers.write_text(bags("build", "--print-config").stdout)
        given = [self.bag, "--places", f"csv:{self.places}", "--config", numbers]
        bags("build", *given, "--out", folder / "same.map")
        self.assertEqual(digest(folder / "same.map"), self.expected)
        numbers.write_text("[learn]\nfeatures-per-visit = 60\n[localize]\nrisk = 0.5\n")
        bags("build", *given, "--out", folder / "small.map")
        run(CHRONOTOPE, "map", "build", "--data", STREET, "--config", numbers, "--out", folder / "folder.map")
        self.assertEqual(digest(folder / "small.map"), digest(folder / "folder.map"))
        shown = bags("localize", "--config", numbers, "--print-config").stdout
        self.assertIn("risk = 0.5", shown)
        numbers.write_text("[learn]\nfeatures-per-visits = 60\n")
        done = bags("localize", self.map, self.bag, "--config", numbers, codes=(2,))
        self.assertIn("line 2", done.stderr)
        self.assertIn("features-per-visits", done.stderr)

    def test_big_endian_and_unchunked_messages_are_read(self) -> None:
        bag = self.new_folder() / "street.mcap"
        with bag.open("wb") as file:
            writer = RawWriter(file, use_chunking=False)
            writer.start("ros2", "test")
            schema = writer.register_schema(PACKED, "ros2msg", b"")
            channel = writer.register_channel(TOPIC, "cdr", schema)
            for it in self.pictures:
                data = TYPES.serialize_cdr(it.message(None), PACKED, little_endian=False)
                self.assertEqual(bytes(data[:2]), b"\0\0")
                writer.add_message(channel, it.ns, bytes(data), it.ns)
            writer.finish()
        self.check_same_map(bag)

    def test_message_time_or_header_time(self) -> None:
        late = [(topic, kind, ns + 5 * 10**9, it) for topic, kind, ns, it in images(self.pictures, None)]
        bag = self.new_folder() / "street.mcap"
        write_mcap(bag, late, CompressionType.ZSTD)
        self.check_same_map(bag)
        out = self.new_folder() / "late.map"
        done = bags(
            "build", bag, "--out", out, "--stamp", "message",
            "--places", f"csv:{self.places}", codes=(2,),
        )  # fmt: skip
        self.assertIn("no row for their time", done.stderr)

    def test_a_bag_alone_becomes_a_topological_map(self) -> None:
        """Places from odometry, transforms and satellites: the same places by each."""
        types = TYPES.types
        point, quaternion = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
        visit = self.pictures[:4]
        messages = images(visit, None)
        for it in visit:
            x = 10.0 * self.pictures.index(it)
            half = math.pi / 4
            turned = quaternion(0.0, 0.0, math.sin(half), math.cos(half))
            pose = types["geometry_msgs/msg/Pose"](point(1.0, x, 0.0), turned)
            stamped = types["geometry_msgs/msg/PoseStamped"](it.header(), pose)
            with_cov = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
            zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            twist = types["geometry_msgs/msg/Twist"](zero, zero)
            twist = types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
            odometry = types["nav_msgs/msg/Odometry"](it.header(), "base", with_cov, twist)
            move = types["geometry_msgs/msg/Transform"](
                types["geometry_msgs/msg/Vector3"](1.0, x, 0.0), turned
            )
            transform = types["geometry_msgs/msg/TransformStamped"](it.header(), "base", move)
            status = types["sensor_msgs/msg/NavSatStatus"](0, 1)
            fix = types["sensor_msgs/msg/NavSatFix"](
                it.header(), status, 50.0 + x / 111_319.49, 14.0, 200.0, np.zeros(9), 0
            )
            name = types["std_msgs/msg/String"](it.place)
            tree = types["tf2_msgs/msg/TFMessage"]([transform])
            for topic, kind, message in [
                ("/pose", "geometry_msgs/msg/PoseStamped", stamped),
                ("/odom", "nav_msgs/msg/Odometry", odometry),
                ("/tf", "tf2_msgs/msg/TFMessage", tree),
                ("/fix", "sensor_msgs/msg/NavSatFix", fix),
                ("/place", "std_msgs/msg/String", name),
            ]:
                messages.append((topic, kind, it.ns, message))
        bag = self.new_folder() / "walk"
        write_rosbags(bag, sorted(messages, key=lambda it: it[2]), StoragePlugin.MCAP)
        for places in ["poses:/pose", "poses:/odom", "tf:camera,base", "poses:/fix", "topic:/place"]:
            with self.subTest(places=places):
                out = self.new_folder() / "walk.map"
                bags("build", bag, "--out", out, "--places", places)
                nodes = json.loads(run(CHRONOTOPE, "map", "inspect", out, "--json").stdout)
                self.assertEqual(nodes["num_places"], 4, nodes)
                self.assertEqual(len(nodes["edges"]), 3, nodes["edges"])
                if places.startswith(("poses", "tf")):
                    names = [it["key"] for it in nodes["places"]]
                    self.assertEqual(names, ["0001@090", "0002@090", "0003@090", "0004@090"])
                    # The same way again: the same places.
                    more = ["--origin", "50.0,14.0"] if places == "poses:/fix" else []
                    done = bags("update", out, bag, "--places", places, *more)
                    self.assertIn("4 places", done.stdout)
                    self.assertIn("0 learnt now", done.stdout)
        out = self.new_folder() / "walk.map"
        done = bags("build", bag, "--out", out, "--places", "poses", codes=(2,))
        self.assertIn("3 topics have poses", done.stderr)
        done = bags("build", bag, "--out", out, "--places", "tf:map,base", codes=(2,))
        self.assertIn("camera -> base", done.stderr)

    def test_answers_are_read_back_by_others(self) -> None:
        out = self.new_folder() / "answers.mcap"
        done = bags("localize", self.map, self.bag, "--out", out, "--json", codes=(0, 1))
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        self.assertEqual(len(lines), len(self.pictures))
        with out.open("rb") as file:
            found = list(make_reader(file, validate_crcs=True).iter_messages())
        by_topic: dict[str, list] = {}
        for schema, channel, message in found:
            self.assertEqual((schema.encoding, channel.message_encoding), ("jsonschema", "json"))
            json.loads(schema.data)
            by_topic.setdefault(channel.topic, []).append((message, json.loads(message.data)))
        self.assertEqual(sorted(by_topic), ["/chronotope/annotations", "/chronotope/localization"])
        answers = by_topic["/chronotope/localization"]
        for (message, answer), line, it in zip(answers, lines, self.pictures, strict=True):
            self.assertEqual(message.log_time, it.ns)
            self.assertEqual((answer["decision"], answer["place"]), (line["decision"], line["place"]))
            self.assertEqual(answer["place"] or it.place, it.place)
            self.assertTrue(answer["predicted"])
        located = sum(answer["decision"] == "at" for _, answer in answers)
        self.assertGreaterEqual(located, 18, "learnt images are located")
        for _, drawn in by_topic["/chronotope/annotations"]:
            self.assertEqual(len(drawn["points"]), 3)
        # The command says the same of the files.
        files = [STREET / "camera/image" / f"{it.ns // 10**9}.000000000" for it in self.pictures]
        done = run(CHRONOTOPE, "localize", self.map, *files, "--json", codes=(0, 1))
        folder = [json.loads(line) for line in done.stdout.splitlines()]
        keys = ["decision", "place", "best", "second", "elsewhere", "num_inliers", "reason"]
        for line, other in zip(lines, folder, strict=True):
            self.assertEqual([line[key] for key in keys], [other[key] for key in keys])
        # An earlier bag of answers is replaced, any other is not.
        bags("localize", self.map, self.bag, "--out", out, codes=(0, 1))
        done = bags("localize", self.map, self.bag, "--out", self.bag, codes=(2,))
        self.assertIn("error", done.stderr)
        self.assertGreater(self.bag.stat().st_size, 0)

    def test_a_bag_that_was_cut_off_is_read_up_to_the_cut(self) -> None:
        whole = self.bag.read_bytes()
        counts = []
        for share in [0.95, 0.7, 0.4]:
            cut = self.new_folder() / "street.mcap"
            cut.write_bytes(whole[: int(len(whole) * share)])
            done = bags("check", cut, "--json", codes=(1,))
            report = json.loads(done.stdout)
            counts.append(report["images"]["num_readable"])
            self.assertIn("cut off", report["problems"][0]["message"])
            out = self.new_folder() / "cut.map"
            done = bags("build", cut, "--out", out, "--places", f"csv:{self.places}", codes=(1,))
            self.assertIn("cut off", done.stderr)
        self.assertEqual(counts, sorted(counts, reverse=True))
        self.assertTrue(24 > counts[1] > counts[2] > 0, counts)
        # Room that was given to the file, but nothing written to it.
        cut = self.new_folder() / "street.mcap"
        cut.write_bytes(whole[: len(whole) // 2] + bytes(len(whole) // 2))
        self.assertIn("problem", bags("check", cut, codes=(1,)).stdout)

    def test_foreign_and_empty_files_have_named_errors(self) -> None:
        folder = self.new_folder()
        for name, content, words in [
            ("empty.mcap", b"", "the file is empty"),
            ("zeros.mcap", bytes(1000), "begins with zeros"),
            ("ros1.bag", b"#ROSBAG V2.0\n" + bytes(99), "a bag of ROS 1"),
            ("text.mcap", b"hello, this is text\n", "no bag"),
            ("head.mcap", b"\x89MCAP", "ends inside"),
            ("magic.mcap", b"\x89MCAP0\r\n", "no messages"),
            ("other.db3", b"SQLite format 3\0" + bytes(200), "database"),
        ]:
            path = folder / name
            path.write_bytes(content)
            done = bags("check", path, codes=(2,))
            self.assertIn(words, done.stderr, name)
            self.assertIn(name, done.stderr)
            self.assertIn("help:", done.stderr)
        self.assertIn("no bag in this folder", bags("check", self.new_folder(), codes=(2,)).stderr)
        self.assertIn("none.mcap", bags("check", folder / "none.mcap", codes=(2,)).stderr)
        done = bags("localize", self.map, self.bag, "--topic", "/nowhere", codes=(2,))
        self.assertIn("topics with images: /camera/image", done.stderr)

    def test_damage_is_named_and_never_a_panic(self) -> None:
        for bag in [self.bag, self.database()]:
            whole = bag.read_bytes()
            state = 7
            for _ in range(24):
                damaged = bytearray(whole)
                for _ in range(3):
                    state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
                    damaged[(state >> 20) % len(damaged)] ^= 1 << (state >> 60) % 8
                path = self.new_folder() / bag.name
                path.write_bytes(damaged)
                done = bags("check", path, codes=(0, 1, 2))
                self.assertNotIn("panicked", done.stderr)
        # A chunk whose checksum does not fit is left out; the others are read.
        damaged = bytearray(self.bag.read_bytes())
        damaged[len(damaged) // 3] ^= 1
        path = self.new_folder() / "street.mcap"
        path.write_bytes(damaged)
        report = json.loads(bags("check", path, "--json", codes=(1,)).stdout)
        self.assertTrue(0 < report["images"]["num_readable"] < 24, report["problems"])

    def database(self) -> Path:
        folder = self.new_folder() / "street"
        write_rosbags(folder, images(self.pictures, None), StoragePlugin.SQLITE3)
        return next(folder.glob("*.db3"))

    def test_lengths_that_lie_take_no_memory(self) -> None:
        bag = self.new_folder() / "street.mcap"
        chunk = struct.pack("<QQQI", 0, 1, 1 << 62, 0) + struct.pack("<I", 4) + b"zstd"
        chunk += struct.pack("<Q", 4) + b"\0\0\0\0"
        body = b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", len(chunk)) + chunk
        bag.write_bytes(body)
        self.assertIn("in one piece", bags("check", bag, codes=(2,)).stderr)
        bag.write_bytes(b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", 1 << 62) + b"abc")
        self.assertIn("cut off", bags("check", bag, codes=(2,)).stderr)

    def test_the_layout_shows_what_is_in_the_files(self) -> None:
        answers = self.new_folder() / "answers.mcap"
        bags("localize", self.map, self.bag, "--out", answers, codes=(0, 1))
        said = {}
        with answers.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                said.setdefault(channel.topic, (schema.name, json.loads(message.data)))
        with self.bag.open("rb") as file:
            recorded = {it.topic for it in make_reader(file).get_summary().channels.values()}
        layout = json.loads(bags("layout", "--topic", TOPIC).stdout)
        panels = layout["configById"]
        shown = panels["Image!chronotope"]["imageMode"]
        self.assertIn(shown["imageTopic"], recorded)
        (annotations,) = shown["annotations"]
        self.assertEqual(said[annotations][0], "foxglove.ImageAnnotations")
        self.assertIn("%", said[annotations][1]["texts"][0]["text"])
        self.assertIn(panels["RawMessages!chronotope"]["topicPath"], said)
        paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
        self.assertEqual(len(paths), 4)
        for path in paths:
            topic, field = path.split(".")
            self.assertIn(field, said[topic][1])
        # Each panel stands somewhere.
        placed = [layout["layout"]]
        while any(isinstance(it, dict) for it in placed):
            placed = [
                part
                for it in placed
                for part in ([it["first"], it["second"]] if isinstance(it, dict) else [it])
            ]
        self.assertEqual(sorted(placed), sorted(panels))
        self.assertIn("/camera/image_raw", bags("layout").stdout)


if __name__ == "__main__":
    unittest.main(verbosity=2)
