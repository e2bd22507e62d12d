"""What arrives is an equal, checked message or a MalformedMessage with a reason; never anything else."""

import math
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.errors import MalformedMessage
from agents.health.histogram import BINS
from agents.wire import codec
from agents.wire import messages as m
from agents.wire.topics import (
    EVENT,
    HEALTH,
    PICTURE,
    PLAN,
    POSE,
    POSTERIOR,
    SET,
    SOFT_OBSERVATION,
    START,
    TOPICS,
    TRUTH,
    Topic,
)

REASONS = {
    "oversize",
    "not_msgpack",
    "schema_version",
    "wrong_type",
    "wrong_team",
    "wrong_sender",
    "not_finite",
    "wrong_shape",
}
HEAD: dict[str, Any] = {"team": "t", "sender": "r1", "boot": "b0", "sequence": 3, "time": 12.5}
MARKS = {"r1/b0": m.Watermark(upto=3, beyond=[(5, 5), (8, 9)]), "r2/b1": m.Watermark(upto=-1)}


def wish(rng: np.random.Generator, d: int) -> m.Wish:
    """An operator's, of a place in d dimensions."""
    place = [float(x) for x in rng.normal(size=d)]
    return m.Wish(name="door", place=place, worth=1.0, robots=2, needs=["thermal"], asked=3.5, looked=["r2"])


def examples(seed: int = 0, d: int = 2, m_: int = 3, c: int = 2, f: int = 1) -> dict[str, m.Message]:
    """One valid message of every topic, with arrays of the given lengths."""
    rng = np.random.default_rng(seed)
    estimate: dict[str, Any] = {
        "applied": 6,
        "expected_cardinality": 4.2,
        "means": rng.normal(size=(d, c)),
        "covariances": rng.normal(size=(c, d, d)),
        "masses": rng.random(c),
        "radii": rng.random(c),
        "velocities": rng.normal(size=(d, c)),
        "found": rng.normal(size=(d, f)),
        "found_covariances": rng.normal(size=(f, d, d)),
        "found_velocities": rng.normal(size=(d, f)),
        "found_times": rng.random(f),
        "found_labels": np.arange(f),
    }
    return {
        "pose": m.PoseMessage(
            **HEAD, pose=rng.normal(size=4), velocity=rng.normal(size=3), state="flying", travelled=3.5
        ),
        "set": m.MeasurementSetMessage(
            **HEAD, pose=rng.normal(size=4), measurements=rng.normal(size=(m_, d))
        ),
        "soft_observation": m.SoftObservationMessage(
            **HEAD,
            relation="inside",
            points=rng.normal(size=(3 + m_, 2)),
            yaw=0.0,
            inner=0.0,
            outer=0.0,
            slope=2.0,
            positive=bool(seed % 2),
            target="cone 3" if c else "",
        ),
        "plan": m.PlanMessage(
            **HEAD,
            plan_version=4,
            waypoint=rng.normal(size=3),
            start_time=1.0,
            end_time=2.0,
            measure_times=rng.normal(size=m_),
            measure_poses=rng.normal(size=(m_, 4)),
            times=rng.normal(size=c),
            poses=rng.normal(size=(c, 4)),
            conditioned_on={"r2": 7},
            objective=-1.5,
            reason="nearest cluster",
        ),
        "bid": m.BidMessage(
            **HEAD,
            said=1234.5,
            tasks=[f"task-{i}" for i in range(c)],
            places=rng.normal(size=(c, d)),
            path=["task-0"] * (c > 0),
            winning_bids={"task-0": 0.7, "door#1": 0.2},
            winning_agents={"task-0": "r1", "door#1": "r2"},
            timestamps={"r2": 99.5},
            digests={"r1": 2**40, "r2": 7},
            wishes=[wish(rng, d)] * c,
        ),
        "request": m.RequestMessage(**HEAD, wish=wish(rng, d)),
        "resume": m.ResumeMessage(**HEAD, robot="r1"),
        "posterior": m.PosteriorMessage(**HEAD, **estimate, watermark=MARKS),
        "belief": m.BeliefMessage(**HEAD, **estimate),
        "state": m.StateMessage(**HEAD, watermark=MARKS, applied=6, state=rng.bytes(20)),
        "ledger": m.LedgerMessage(**HEAD, first="", last="r2/b1", holds=MARKS, expired=MARKS),
        "relay": m.RelayMessage(**HEAD, entries=[m.Relayed(topic="set", sender="r2", payload=b"abc")] * c),
        "picture": m.PictureMessage(
            **HEAD,
            exploration=rng.integers(0, 256, size=(5,) * d).astype(np.uint8),
            points=rng.normal(size=(d, 7)).astype(np.float32),
            weights=rng.random(7).astype(np.float32),
        ),
        "start": m.StartMessage(
            **HEAD,
            epoch=1.7e9,
            speed=2.0,
            seed=7,
            mission_hash="ab" * 32,
            answers={"r1/b": np.array([3.5, 4.25])},
        ),
        "clock": m.ClockMessage(**HEAD, shown=3.5),
        "health": m.HealthMessage(
            **HEAD,
            role="robot",
            state="running",
            counters={"published": 3},
            gauges={"cpu": 0.2},
            histograms={"plan_ms": rng.integers(0, 9, BINS)},
        ),
        "event": m.EventMessage(**HEAD, level="info", text="found a target", about="o/b0/3" if c else ""),
        "truth": m.TruthMessage(**HEAD, targets=rng.normal(size=(d, c))),
    }


EXAMPLES = examples()
PAYLOADS = {name: codec.encode(message) for name, message in EXAMPLES.items()}


def decode(topic: Topic, payload: bytes) -> m.Message:
    return codec.decode(topic, payload, team="t", sender="r1")


def reason(topic: Topic, payload: bytes) -> str:
    with pytest.raises(MalformedMessage) as caught:
        decode(topic, payload)
    assert caught.value.reason in REASONS
    return caught.value.reason


def changed(topic: Topic, **fields: Any) -> bytes:
    """The example of a topic with some fields replaced on the wire; None removes one."""
    raw = msgpack.unpackb(PAYLOADS[topic.name])
    raw.update(fields)
    packed: bytes = msgpack.packb({key: value for key, value in raw.items() if value is not None})
    return packed


def wire(array: Any, dtype: str = "<f8") -> dict[str, Any]:
    array = np.asarray(array, dtype)
    return {"d": dtype, "s": list(array.shape), "b": array.tobytes()}


def assert_same(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, msgspec.Struct):
        for name in one.__struct_fields__:
            assert_same(getattr(one, name), getattr(other, name))
    else:
        assert one == other


def test_every_topic_has_an_example_and_every_array_a_declared_shape() -> None:
    assert EXAMPLES.keys() == TOPICS.keys()
    for message in EXAMPLES.values():
        arrays = {
            name
            for name in message.__struct_fields__
            if isinstance(value := getattr(message, name), np.ndarray)
            or (isinstance(value, dict) and any(isinstance(item, np.ndarray) for item in value.values()))
        }
        assert arrays == codec.ARRAYS.get(type(message), {}).keys()


@given(
    seed=st.integers(0, 2**32 - 1),
    d=st.sampled_from([2, 3]),
    m_=st.integers(0, 20),
    c=st.integers(0, 20),
    f=st.integers(0, 20),
)
@settings(max_examples=30, deadline=None)
def test_every_message_comes_back_equal(seed: int, d: int, m_: int, c: int, f: int) -> None:
    for name, message in examples(seed, d, m_, c, f).items():
        assert_same(decode(TOPICS[name], codec.encode(message)), message)


def test_decoded_arrays_are_what_compiled_kernels_take() -> None:
    for name, payload in PAYLOADS.items():
        message = decode(TOPICS[name], payload)
        for field in message.__struct_fields__:
            value = getattr(message, field)
            if isinstance(value, np.ndarray):
                assert value.flags.c_contiguous
                assert value.flags.writeable
                assert value.flags.aligned
                assert value.dtype.isnative


def test_arrays_of_any_layout_are_sent_as_declared() -> None:
    poses = np.arange(16, dtype=np.float32).reshape(4, 4)
    message = m.MeasurementSetMessage(**HEAD, pose=poses[:, 1], measurements=poses[::2, ::2].T)
    got = decode(SET, codec.encode(message))
    assert isinstance(got, m.MeasurementSetMessage)
    np.testing.assert_array_equal(got.measurements, poses[::2, ::2].T)
    assert got.pose.dtype == np.float64


def test_a_float_array_is_not_silently_cut_to_bytes() -> None:
    message = m.PictureMessage(
        **HEAD, exploration=np.ones((2, 2)), points=np.zeros((2, 0)), weights=np.zeros(0)
    )
    with pytest.raises(TypeError):
        codec.encode(message)


def test_oversize_is_named_before_anything_is_parsed() -> None:
    assert reason(POSE, b"\x00" * (POSE.max_bytes + 1)) == "oversize"


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x81",
        b"\xd9\xff",
        b"\x81\xa1a\x01rest",
        b"\xa1\xff",  # not UTF-8
        b"\x81\x01\x02",  # a key that is no string
        b"\x81\xc4\x80",
        b"\xdf\xff\xff\xff\xff",  # 4 billion pairs claimed
        b"\xdd\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xd4\x01\x00",  # extension
        b"\xd6\xff\x00\x00\x00\x01",  # timestamp
        b"\x91" * 1500,  # deeper than any message
        b"\x81\xa1a" * 600,
        b"\xdd\x00\x00\x27\x10" * 400,  # nested lists of 10,000 claimed items each
    ],
)
def test_what_is_not_message_pack_is_named(payload: bytes) -> None:
    assert reason(POSE, payload) == "not_msgpack"


@pytest.mark.parametrize("payload", [b"\x01", b"\x90", b"\xc0", b"\xa1a", b"\xcb" + b"\x7f" * 8])
def test_a_payload_that_is_no_map_has_the_wrong_type(payload: bytes) -> None:
    assert reason(POSE, payload) == "wrong_type"


@pytest.mark.parametrize("version", [0, 2, True, 1.0, "1", None, 2**63])
def test_another_schema_version_is_named(version: Any) -> None:
    assert reason(POSE, changed(POSE, version=version)) == "schema_version"


@pytest.mark.parametrize(
    ("topic", "fields"),
    [
        (POSE, {"time": "now"}),
        (POSE, {"time": None}),
        (POSE, {"extra": 1}),
        (POSE, {"sequence": -1}),
        (POSE, {"sequence": True}),
        (POSE, {"boot": "a b"}),
        (POSE, {"state": "x" * 33}),
        (POSE, {"pose": [1.0, 2.0, 3.0, 4.0]}),
        (POSE, {"pose": wire([1, 2, 3, 4], "<f4")}),
        (POSE, {"pose": {**wire([1, 2, 3, 4]), "d": ">f8"}}),
        (POSE, {"pose": {**wire([1, 2, 3, 4]), "d": "|O8"}}),
        (POSE, {"pose": {**wire([1, 2, 3, 4]), "more": 1}}),
        (POSE, {"pose": {"d": ["<f8"], "s": [4], "b": b""}}),
        (START, {"speed": 0.0}),
        (EVENT, {"level": "fatal"}),
        (EVENT, {"text": "x" * 2001}),
        (EVENT, {"about": "x" * 201}),
        (SOFT_OBSERVATION, {"relation": "beside"}),
        (SOFT_OBSERVATION, {"slope": 0.0}),
        (SOFT_OBSERVATION, {"slope": math.inf}),
        (SOFT_OBSERVATION, {"slope": 1001.0}),
        (SOFT_OBSERVATION, {"positive": 1}),
        (SOFT_OBSERVATION, {"target": None}),
        (SOFT_OBSERVATION, {"target": "x" * 65}),
        (SOFT_OBSERVATION, {"outer": 5.0}),  # a region has no distance
        (SOFT_OBSERVATION, {"points": wire([[0, 0], [1e8, 0], [0, 1]])}),
        (SOFT_OBSERVATION, {"relation": "near", "points": wire([[0, 0]])}),
        (SOFT_OBSERVATION, {"relation": "near", "points": wire([[0, 0]]), "inner": 4.0, "outer": 4.0}),
        (SOFT_OBSERVATION, {"relation": "far", "points": wire([[0, 0]]), "inner": -1.0, "outer": 4.0}),
        (SOFT_OBSERVATION, {"relation": "near", "points": wire([[0, 0]]), "inner": 1.0, "outer": 1e8}),
        (SOFT_OBSERVATION, {"relation": "left", "points": wire([[0, 0]]), "inner": 1.0}),
        (SOFT_OBSERVATION, {"relation": "left", "points": wire([[0, 0]]), "outer": -1.0}),
        (PLAN, {"conditioned_on": {"r2": 1.5}}),
        (POSTERIOR, {"watermark": {"r1/b": {"upto": -2}}}),
        (HEALTH, {"histograms": {"plan_ms": wire(np.zeros(BINS))}}),
    ],
)
def test_wrong_types_and_values_are_named(topic: Topic, fields: dict[str, Any]) -> None:
    assert reason(topic, changed(topic, **fields)) == "wrong_type"


def test_a_foreign_team_or_sender_is_named() -> None:
    assert reason(POSE, changed(POSE, team="other")) == "wrong_team"
    assert reason(POSE, changed(POSE, sender="r2")) == "wrong_sender"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("topic", "field"),
    [
        (POSE, "time"),
        (POSE, "travelled"),
        (PLAN, "objective"),
        (POSTERIOR, "expected_cardinality"),
        (SOFT_OBSERVATION, "yaw"),
        (SOFT_OBSERVATION, "inner"),
        (SOFT_OBSERVATION, "outer"),
    ],
)
def test_numbers_that_are_not_finite_are_named(topic: Topic, field: str, bad: float) -> None:
    assert reason(topic, changed(topic, **{field: bad})) == "not_finite"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_arrays_and_gauges_that_are_not_finite_are_named(bad: float) -> None:
    assert reason(POSE, changed(POSE, pose=wire([0, bad, 0, 0]))) == "not_finite"
    assert reason(SET, changed(SET, measurements=wire([[1, 2], [bad, 1]]))) == "not_finite"
    assert reason(TRUTH, changed(TRUTH, targets=wire([[bad], [0]]))) == "not_finite"
    corners = wire([[0, 0], [bad, 0], [0, 1]])
    assert reason(SOFT_OBSERVATION, changed(SOFT_OBSERVATION, points=corners)) == "not_finite"
    assert reason(PICTURE, changed(PICTURE, weights=wire([bad] * 7, "<f4"))) == "not_finite"
    assert reason(HEALTH, changed(HEALTH, gauges={"cpu": bad})) == "not_finite"


def test_huge_finite_numbers_are_finite() -> None:
    payload = changed(POSE, pose=wire([1e300, -1e300, 1.7e308, 0]))
    assert isinstance(decode(POSE, payload), m.PoseMessage)


@pytest.mark.parametrize(
    ("topic", "fields"),
    [
        (POSE, {"pose": wire([0, 0, 0])}),
        (POSE, {"pose": wire([[0, 0, 0, 0]])}),
        (POSE, {"pose": {**wire([0, 0, 0, 0]), "s": [2**62]}}),
        (POSE, {"pose": {**wire([0, 0, 0, 0]), "s": [-4]}}),
        (POSE, {"pose": {**wire([0, 0, 0, 0]), "s": [True, 4]}}),
        (POSE, {"pose": {**wire([0, 0, 0, 0]), "s": [4.0]}}),
        (POSE, {"pose": {**wire([0, 0, 0, 0]), "s": [1] * 60 + [4]}}),
        (POSE, {"pose": {"d": "<f8", "s": [0, 2**31 - 1], "b": b""}}),
        (SET, {"measurements": wire([1, 2])}),
        (SET, {"measurements": {"d": "<f8", "s": [2**31 - 1, 0], "b": b""}}),
        (SET, {"measurements": wire(np.zeros((1, 17)))}),
        (SOFT_OBSERVATION, {"points": wire(np.zeros((3, 3)))}),
        (SOFT_OBSERVATION, {"points": wire(np.zeros((0, 2)))}),
        (SOFT_OBSERVATION, {"points": wire(np.zeros((2, 2)))}),  # no region
        (SOFT_OBSERVATION, {"points": wire(np.zeros((65, 2)))}),
        (SOFT_OBSERVATION, {"relation": "near", "points": wire(np.zeros((2, 2)))}),
        (SOFT_OBSERVATION, {"relation": "behind", "points": wire(np.zeros((3, 2)))}),
        (PLAN, {"measure_times": wire([1.0])}),
        (PLAN, {"poses": wire(np.zeros((2, 3)))}),
        (POSTERIOR, {"found": wire(np.zeros((3, 1)))}),
        (POSTERIOR, {"found_times": wire([1.0, 2.0])}),
        (POSTERIOR, {"covariances": wire(np.zeros((2, 2, 3)))}),
        (POSTERIOR, {"covariances": wire(np.zeros((1, 2, 2)))}),
        (PICTURE, {"exploration": wire(np.zeros((5, 5, 5)), "|u1")}),
        (PICTURE, {"exploration": wire(np.zeros((5, 0)), "|u1")}),
        (TRUTH, {"targets": wire(np.zeros((4, 1)))}),
        (HEALTH, {"histograms": {"plan_ms": wire(np.zeros(3), "<i8")}}),
    ],
)
def test_wrong_shapes_are_named(topic: Topic, fields: dict[str, Any]) -> None:
    assert reason(topic, changed(topic, **fields)) == "wrong_shape"


def survives(topic: Topic, payload: bytes) -> None:
    """Decoding gives a valid message or a MalformedMessage with a known reason."""
    try:
        message = decode(topic, payload)
    except MalformedMessage as error:
        assert error.reason in REASONS  # noqa: PT017
    else:
        assert_same(decode(topic, codec.encode(message)), message)


@given(topic=st.sampled_from(list(TOPICS.values())), payload=st.binary(max_size=300))
@settings(deadline=None)
def test_random_bytes_never_raise_anything_else(topic: Topic, payload: bytes) -> None:
    survives(topic, payload)


@pytest.mark.parametrize("name", PAYLOADS)
def test_every_truncation_is_refused(name: str) -> None:
    payload = PAYLOADS[name]
    for end in {*range(min(len(payload), 300)), *range(0, len(payload), 97), len(payload) - 1}:
        assert reason(TOPICS[name], payload[:end]) == "not_msgpack"


@given(
    name=st.sampled_from(list(PAYLOADS)),
    edits=st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), min_size=1, max_size=8),
)
@settings(max_examples=500, deadline=None)
def test_mutated_messages_never_raise_anything_else(name: str, edits: list[tuple[int, int]]) -> None:
    payload = bytearray(PAYLOADS[name])
    for position, value in edits:
        payload[position % len(payload)] = value
    survives(TOPICS[name], bytes(payload))


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=40)
    | st.sampled_from([wire([1.0]), wire(np.zeros((2, 2))), wire([], "|u1"), "<f8"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=8,
)


@given(data=st.data(), topic=st.sampled_from(list(TOPICS.values())), value=VALUES)
@settings(max_examples=500, deadline=None)
def test_a_field_of_any_other_value_never_raises_anything_else(
    data: st.DataObject, topic: Topic, value: Any
) -> None:
    field = data.draw(st.sampled_from(topic.message.__struct_fields__))
    survives(topic, changed(topic, **{field: value}))


@given(
    name=st.sampled_from(["<f8", "<f4", "|u1", "<i8", "<c8", "", "O"]),
    shape=st.lists(st.integers(-3, 2**64 - 1) | st.integers(0, 5), max_size=6),
    data=st.binary(max_size=80),
)
@settings(max_examples=300, deadline=None)
def test_arrays_that_lie_about_themselves_never_raise_anything_else(
    name: str, shape: list[int], data: bytes
) -> None:
    for topic, field in (
        (POSE, "pose"),
        (SET, "measurements"),
        (PICTURE, "exploration"),
        (SOFT_OBSERVATION, "points"),
    ):
        survives(topic, changed(topic, **{field: {"d": name, "s": shape, "b": data}}))
