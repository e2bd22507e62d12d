"""Maps of ROS map_server: every mode as map_server's own code has it, and errors that name file and key."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agents.errors import DataError
from bridges.ros_map import occupancy, read_header, read_map
from estimator.maps.occupancy import FREE, OCCUPIED, UNKNOWN

DEPOT = Path(__file__).resolve().parents[3] / "shared" / "data" / "maps" / "depot.yaml"
SHADES = np.array([[0, 80, 128], [200, 230, 255]], dtype=np.uint8)


def write(
    directory: Path, picture: Image.Image | str | None = None, name: str = "m.pgm", **keys: object
) -> Path:
    """A map in `directory`; keys given as None are left out."""
    table: dict[str, object] = {
        "image": name,
        "resolution": 0.1,
        "origin": [1.0, 2.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.25,
    }
    table |= keys
    (directory / "m.yaml").write_text("".join(f"{k}: {v}\n" for k, v in table.items() if v is not None))
    if isinstance(picture, str):
        (directory / name).write_text(picture)
    elif picture is not None:
        picture.save(directory / name)
    return directory / "m.yaml"


def percent(file: Path) -> list[list[int]]:
    """Rows from the top, as the picture has them."""
    return np.asarray(occupancy(read_header(file))[::-1]).tolist()


@pytest.mark.parametrize("name", ["m.pgm", "m.png"])
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        # occupied: 1 - shade / 255 = 1, 0.686, 0.498 / 0.216, 0.098, 0
        ({}, [[100, 100, -1], [0, 0, 0]]),
        ({"mode": "trinary", "free_thresh": 0.196}, [[100, 100, -1], [-1, 0, 0]]),
        ({"negate": 1}, [[0, -1, -1], [100, 100, 100]]),
        ({"negate": "true"}, [[0, -1, -1], [100, 100, 100]]),
        ({"mode": "scale"}, [[100, 100, 62], [0, 0, 0]]),  # (0.498 - 0.25) / 0.4
        ({"mode": "scale", "free_thresh": 0.05, "occupied_thresh": 0.7}, [[100, 98, 69], [25, 7, 0]]),
        ({"mode": "raw"}, [[0, 80, -1], [-1, -1, -1]]),
        ({"mode": "raw", "negate": 1}, [[0, 80, -1], [-1, -1, -1]]),
    ],
)
def test_every_mode_gives_map_servers_percentages(
    tmp_path: Path, name: str, keys: dict[str, object], expected: list[list[int]]
) -> None:
    assert percent(write(tmp_path, Image.fromarray(SHADES), name, **keys)) == expected


def test_percentages_become_free_occupied_and_unknown_cells_with_the_lowest_row_first(tmp_path: Path) -> None:
    trinary = read_map(write(tmp_path, Image.fromarray(SHADES)))
    np.testing.assert_array_equal(trinary.cells, [[FREE] * 3, [OCCUPIED, OCCUPIED, UNKNOWN]])
    raw = read_map(write(tmp_path, Image.fromarray(SHADES // 3), mode="raw"))  # 0 26 42 / 66 76 85
    np.testing.assert_array_equal(raw.cells, [[OCCUPIED] * 3, [FREE, UNKNOWN, UNKNOWN]])
    scale = read_map(write(tmp_path, Image.fromarray(SHADES), mode="scale"))
    np.testing.assert_array_equal(scale.cells, trinary.cells)


def test_transparency_counts_as_a_channel_in_trinary_and_as_unknown_in_scale(tmp_path: Path) -> None:
    pixels = np.array([[[0, 0, 0, 255], [255, 255, 255, 0], [0, 0, 0, 0]]], dtype=np.uint8)
    image = Image.fromarray(pixels, "RGBA")
    assert percent(write(tmp_path, image, "m.png")) == [
        [100, -1, 100]
    ]  # 0.75 occupied; 0.25 is not below 0.25
    assert percent(write(tmp_path, image, "m.png", mode="scale")) == [[100, -1, -1]]


def test_a_colour_is_the_mean_of_its_channels(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[[255, 0, 0], [255, 255, 0], [255, 255, 255]]], dtype=np.uint8))
    assert percent(write(tmp_path, image, "m.png")) == [[100, -1, 0]]  # 0.667, 0.333, 0 occupied


def test_a_pgm_of_plain_text_and_a_png_of_16_bits_are_read(tmp_path: Path) -> None:
    assert percent(write(tmp_path, "P2\n# made by hand\n3 1\n10\n0 5 10\n")) == [[100, -1, 0]]
    deep = Image.fromarray(np.array([[0, 32768, 65535]], dtype=np.uint16))
    assert percent(write(tmp_path, deep, "m.png")) == [[100, -1, 0]]


def test_the_origin_turns_and_moves_the_map(tmp_path: Path) -> None:
    made = read_map(write(tmp_path, Image.fromarray(SHADES), origin=[10, 20, np.pi / 2]))
    wall = np.array([[0.15], [0.05]])  # in the map's own axes: column 1 of the top row is row 1
    x, y = wall[:, 0] + [0.0, 0.1]
    assert made.at(np.array([[10 - y], [20 + x]]))[0] == OCCUPIED
    assert made.at(np.array([[10 - wall[1, 0]], [20 + x]]))[0] == FREE
    assert made.at(np.array([[10.05], [20.05]]))[0] == UNKNOWN  # outside


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"image": None}, "image: expected the name of a picture, found nothing"),
        ({"resolution": 0}, "resolution: expected a number > 0, found 0"),
        ({"resolution": "-0.1"}, "resolution: expected a number > 0, found -0.1"),
        ({"resolution": ".nan"}, "resolution: expected a number > 0, found nan"),
        ({"resolution": "fine"}, "resolution: expected a number > 0, found 'fine'"),
        ({"origin": [0, 0]}, r"origin: expected 3 numbers x, y, yaw, found \[0, 0\]"),
        ({"origin": "[0, 0, .inf]"}, "origin: expected 3 numbers"),
        ({"negate": None}, "negate: expected 0 or 1, found nothing"),
        ({"negate": 2}, "negate: expected 0 or 1, found 2"),
        ({"mode": "binary"}, "mode: expected one of trinary, scale, raw, found 'binary'"),
        ({"occupied_thresh": 65}, "occupied_thresh: expected a number from 0 to 1, found 65"),
        ({"free_thresh": None}, "free_thresh: expected a number from 0 to 1, found nothing"),
        (
            {"free_thresh": 0.7},
            "free_thresh: expected a number below occupied_thresh, which is 0.65, found 0.7",
        ),
    ],
)
def test_a_wrong_key_is_named_with_its_file(tmp_path: Path, keys: dict[str, object], says: str) -> None:
    file = write(tmp_path, Image.fromarray(SHADES), **keys)
    with pytest.raises(DataError, match=says) as caught:
        read_map(file)
    assert str(file) in str(caught.value)


def test_missing_and_damaged_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"nowhere\.yaml cannot be read"):
        read_map(tmp_path / "nowhere.yaml")
    with pytest.raises(DataError, match=r"m\.yaml: image: .*m\.pgm does not exist"):
        read_map(write(tmp_path))
    with pytest.raises(DataError, match=r"m\.yaml: image: .*m\.pgm cannot be read"):
        read_map(write(tmp_path, "no picture"))
    with pytest.raises(DataError, match=r"m\.yaml: image: .*m\.pgm cannot be read"):
        read_map(write(tmp_path, "P2\n3 2\n255\n0 0\n"))  # breaks off
    for text, says in (("a: [", "is not YAML"), ("- 1", "expected the keys image"), ("", "found nothing")):
        (tmp_path / "m.yaml").write_text(text)
        with pytest.raises(DataError, match=says):
            read_map(tmp_path / "m.yaml")
    (tmp_path / "m.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="is not YAML"):
        read_map(tmp_path / "m.yaml")


@pytest.mark.data
@pytest.mark.skipif(not DEPOT.is_file(), reason=f"{DEPOT} is not there")
def test_the_depot_has_its_size_and_walls() -> None:
    depot = read_map(DEPOT)
    assert depot.cells.shape == (307, 604)
    # At free_thresh 0.25 map_server takes grey 205 (0.196 occupied) for free.
    assert np.count_nonzero(depot.cells == OCCUPIED) == 5947
    assert np.count_nonzero(depot.cells == UNKNOWN) == 0
    hall = depot.reachable_from(np.array([[8.0], [8.0]]))
    assert np.count_nonzero(hall.cells == UNKNOWN) == 4804  # insides of shelves, and what is beyond the walls
    spots = np.array([[8.0, 28.0, 18.3], [2.0, 14.0, 3.2]])
    assert depot.is_free(spots).all()
    assert hall.is_free(spots).tolist() == [True, True, False]
