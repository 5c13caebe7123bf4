"""Is the interpreter's lock let go of, is Ctrl-C heard, and is the package as light as it says?"""

from __future__ import annotations

import importlib.metadata
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import chronotope


def hear_ctrl_c() -> None:
    """For the process that is interrupted."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(code: str, tmp_path: pathlib.Path, *arguments: object) -> tuple[int, str, float]:
    """Runs a script, presses Ctrl-C half a second after it prints `ready`, and gives its exit code, what
    it printed, and how long it went on."""
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(code))
    process = subprocess.Popen(
        [sys.executable, str(script), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        # A shell that starts the tests in the background has its children ignore Ctrl-C.
        preexec_fn=hear_ctrl_c if os.name != "nt" else None,
    )
    assert process.stdout is not None
    for line in process.stdout:
        if "ready" in line:
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    rest = process.stdout.read()
    return process.wait(timeout=60), rest, time.monotonic() - begun


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_localizing_many(learnt: pathlib.Path, tmp_path: pathlib.Path) -> None:
    code, said, took_s = interrupted(
        """
        import sys, numpy, chronotope
        localizer = chronotope.Localizer(sys.argv[1], index_cache="never")
        images = [numpy.random.default_rng(1).integers(0, 256, (384, 448), numpy.uint8)] * 100_000
        print("ready", flush=True)
        localizer.localize_many(images, [0] * len(images), threads=1)
        """,
        tmp_path,
        learnt,
    )
    assert code != 0 and "KeyboardInterrupt" in said and took_s < 20


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_a_fit(tmp_path: pathlib.Path) -> None:
    code, said, took_s = interrupted(
        """
        import numpy, chronotope
        times = numpy.arange(4_000_000) * 60
        states = times % 86_400 < 40_000
        print("ready", flush=True)
        chronotope.Fremen(periods=(604_800.0, 1000), order=5).fit(times, states)
        """,
        tmp_path,
    )
    assert code != 0 and "KeyboardInterrupt" in said and took_s < 20


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_loses_nothing_of_a_build(tmp_path: pathlib.Path) -> None:
    street = chronotope.Street(seed=5, num_places=2)
    learn, _ = street.schedule(60, 1)
    data = chronotope.write_street(street, tmp_path / "data", learn)
    path = tmp_path / "street.map"
    script = """
        import sys, chronotope
        told = lambda done, total: print("ready" if done else "begun", flush=True)
        chronotope.Map.build(sys.argv[1], sys.argv[2], threads=1, progress=told)
        """
    code, said, _ = interrupted(script, tmp_path, data, path)
    if code == 0:
        pytest.skip("it had finished before Ctrl-C came")
    assert "KeyboardInterrupt" in said
    assert not path.exists() and (tmp_path / "street.map.part").exists()
    with chronotope.Map.open(tmp_path / "street.map.part") as part:
        assert sum(len(place.visit_ids) for place in part.places) > 0
    # The same call goes on, and gives the map that an uninterrupted one gives.
    with chronotope.Map.build(data, path) as resumed, chronotope.Map.build(
        data, tmp_path / "at-once.map"
    ) as at_once:
        assert resumed.inspect()["digest"] == at_once.inspect()["digest"]


def test_other_threads_go_on_meanwhile(localizer: chronotope.Localizer, query) -> None:
    """A thread that counts is not held up while this one localises."""
    counts: list[float] = []
    stop = threading.Event()

    def count() -> None:
        while not stop.is_set():
            counts.append(time.monotonic())
            time.sleep(0.0005)

    thread = threading.Thread(target=count)
    thread.start()
    begun = time.monotonic()
    for _ in range(30):
        localizer.localize(query[0], query[1])
    took = time.monotonic() - begun
    stop.set()
    thread.join()
    during = [at for at in counts if begun <= at <= begun + took]
    # With the lock held it would come to its turn once an image.
    assert len(during) > 60


@pytest.mark.skipif(sys.platform != "linux", reason="counts how often threads wait, as Linux does")
def test_two_threads_do_not_wait_for_each_other(localizer: chronotope.Localizer, query) -> None:
    """A thread that waits for the lock gives up its turn: how fast the machine is does not matter."""
    import resource
    from concurrent.futures import ThreadPoolExecutor

    def work(_: int) -> None:
        for _ in range(40):
            localizer.localize(query[0], query[1])

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(work, range(2)))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_nvcsw
        list(pool.map(work, range(2)))
        num_waits = resource.getrusage(resource.RUSAGE_SELF).ru_nvcsw - before
    # With the lock held, every one of the 80 calls would wait for another.
    assert num_waits < 40


def test_a_call_from_python_costs_little(tmp_path: pathlib.Path) -> None:
    """What is spent outside of the engine, by its own clock, on an image of 1024 x 384 px."""
    street = chronotope.Street(seed=3, num_places=2, image_size=(1024, 384))
    learn, query = street.schedule(4, 1)
    path = tmp_path / "street.map"
    chronotope.Map.build(chronotope.write_street(street, tmp_path / "images", learn), path).close()
    image = street.render(street.places[0], query[0])
    shares = []
    with chronotope.Robot(path, index_cache="never") as robot:
        for _ in range(60):
            begun = time.perf_counter()
            robot.see(image, query[0])
            took_s = time.perf_counter() - begun
            shares.append(took_s / sum(robot.timing_s) - 1)
    assert np.median(shares) < 0.05


def test_threads_share_a_localizer(localizer: chronotope.Localizer, street) -> None:
    from concurrent.futures import ThreadPoolExecutor

    _, times = street.schedule(10, 3)
    queries = [(street.render(place, at), at) for at in times for place in street.places] * 4
    expected = [localizer.localize(*it).to_json() for it in queries]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda it: localizer.localize(*it).to_json(), queries)) == expected


def test_numpy_is_the_only_dependency() -> None:
    try:
        requires = importlib.metadata.requires("chronotope") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("it is not installed, but on the path")
    assert [it for it in requires if "extra ==" not in it] == ["numpy>=1.24"]


def test_importing_it_is_quick() -> None:
    """The processor's time, because others may be at work; numpy is there in any case."""
    code = (
        "import time, numpy, numpy.typing; begun = time.process_time(); import chronotope; "
        "print(time.process_time() - begun)"
    )
    took_s = min(
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
        for _ in range(5)
    )
    assert took_s < 0.05


def test_importing_it_loads_nothing_that_it_does_not_need() -> None:
    code = (
        "import sys, chronotope; "
        "print([it for it in ('pandas', 'polars', 'sklearn', 'PIL', 'tqdm', 'logging') if it in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert done.stdout.strip() == "[]"


def test_everything_public_is_documented() -> None:
    from chronotope import explore, series

    undocumented = []
    for module in (chronotope, explore, series):
        assert module.__doc__
        for name in module.__all__:
            found = getattr(module, name)
            if not (found.__doc__ or "").strip():
                undocumented.append(name)
            if isinstance(found, type) and not issubclass(found, BaseException):
                undocumented += [
                    f"{name}.{member}"
                    for member, value in vars(found).items()
                    if not member.startswith("_")
                    and (callable(value) or hasattr(value, "__get__"))
                    and not (value.__doc__ or "").strip()
                ]
    assert undocumented == []


def test_the_examples_of_the_documentation_hold() -> None:
    import doctest

    from chronotope import explore, series

    for module in (chronotope, explore, series):
        assert doctest.testmod(module).failed == 0


def test_numbers_are_not_copies_of_the_caller_s(localizer: chronotope.Localizer, query) -> None:
    image = query[0].copy()
    before = localizer.localize(image, query[1]).to_json()
    assert (image == query[0]).all()
    assert localizer.localize(np.array(image), query[1]).to_json() == before
