"""What makes a mission wrong although each of its keys, taken alone, is right."""

import re
from collections.abc import Mapping
from typing import Any

from agents import plugins
from agents.errors import SearchpartyError
from agents.mission.mission import TASK_KINDS, Mission, RequestTable
from agents.mission.tables import Problem, check, nearest, show
from agents.operator.statements import said

# The tables that a plugin defines: the key in the mission -> the group of entry points that holds the kinds.
GROUPS = {"world": "worlds", "filter": "filters", "planner": "planners"}
ROBOT_GROUPS = {"vehicle": "vehicles", "sensor": "sensors"}

RESERVED_IDS = ("fusion", "swarm", "watch")  # these processes publish under the same keys as robots


def is_reserved(name: str) -> bool:
    """Whether a name is a process's other than a robot's."""
    return name in RESERVED_IDS or re.fullmatch(r"fusion-\d+", name) is not None


_ENDPOINT = re.compile(r"^[a-z][a-z0-9-]*/\S+$")


def kind_tables(raw: Mapping[str, Any]) -> list[tuple[str, str, Any]]:
    """All tables of a mission that a plugin defines: (key path, group, table)."""
    tables = [(key, group, raw[key]) for key, group in GROUPS.items() if key in raw]
    robots = raw.get("robots")
    for i, robot in enumerate(robots if isinstance(robots, list) else []):
        if isinstance(robot, dict):
            tables += [
                (f"robots[{i}].{key}", group, robot[key])
                for key, group in ROBOT_GROUPS.items()
                if key in robot
            ]
    return tables


def check_kind_table(where: str, group: str, table: Any) -> list[Problem]:
    """All mistakes of one plugin's table; one that is no table is reported by the mission's own check."""
    if not isinstance(table, dict):
        return []
    kind = table.get("kind")
    problem = _check_kind(f"{where}.kind", group, kind)
    if problem is not None:
        return [problem]
    try:
        config = plugins.load(group, kind).Config
    except SearchpartyError as error:
        return [Problem(f"{where}.kind", show(kind), str(error))]
    except (ImportError, AttributeError) as error:
        return [Problem(f"{where}.kind", show(kind), f"a kind that can be loaded ({error})")]
    return check({key: value for key, value in table.items() if key != "kind"}, config, where)


def _check_kind(where: str, group: str, kind: Any) -> Problem | None:
    known = plugins.kinds(group)
    if kind in known:
        return None
    allowed = "one of " + (", ".join(known) or "none that is installed")
    if not isinstance(kind, str):
        return Problem(where, "nothing" if kind is None else show(kind), allowed)
    return Problem(where, show(kind), allowed, nearest(kind, known))


def check_mission(mission: Mission) -> list[Problem]:
    """All contradictions within a mission whose keys are right one by one, those of plugins perhaps not."""
    return [
        *_area(mission),
        *_exploration(mission),
        *_candidates(mission),
        *_robots(mission),
        *_map(mission),
        *_link(mission),
        *_statements(mission),
        *_capabilities(mission),
        *(
            p
            for i, table in enumerate(mission.requests)
            for p in request_problems(mission, table, f"requests[{i}].")
        ),
    ]


def _area(mission: Mission) -> list[Problem]:
    low, high = mission.area.min, mission.area.max
    if len(low) != len(high):
        return [Problem("area.max", show(high), f"{len(low)} values, as many as area.min")]
    return [
        Problem(f"area.max[{i}]", show(high[i]), f"a number > {low[i]:g}, which is area.min[{i}]")
        for i in range(len(low))
        if high[i] <= low[i]
    ]


def _exploration(mission: Mission) -> list[Problem]:
    points, d = mission.exploration.points, len(mission.area.min)
    if len(points) != d:
        return [
            Problem("exploration.points", show(points), f"{d} values, one for each dimension of the area")
        ]
    return [
        Problem(f"exploration.points[{i}]", show(n), "a whole number >= 2, to have both edges of the area")
        for i, n in enumerate(points)
        if n < 2
    ]


def _candidates(mission: Mission) -> list[Problem]:
    """Planners that choose from a grid name its corners in a table `candidates`, in two axes or three."""
    table = mission.planner.get("candidates")
    if not isinstance(table, dict):
        return []
    area, problems = mission.area, []
    for key in ("low", "high"):
        corner = table.get(key)
        if not isinstance(corner, list):  # which the planner's own check reports
            continue
        for i, (x, a, b) in enumerate(zip(corner, area.min, area.max, strict=False)):
            if isinstance(x, int | float) and a < b and not a <= x <= b:
                allowed = f"a number from {a:g} to {b:g}, inside the area"
                problems.append(Problem(f"planner.candidates.{key}[{i}]", show(x), allowed))
    return problems


def _robots(mission: Mission) -> list[Problem]:
    problems = []
    first: dict[str, int] = {}
    for i, robot in enumerate(mission.robots):
        if robot.id in first:
            allowed = f"an id of its own; robots[{first[robot.id]}] has this one"
            problems.append(Problem(f"robots[{i}].id", show(robot.id), allowed))
        elif is_reserved(robot.id):
            problems.append(Problem(f"robots[{i}].id", show(robot.id), "not " + ", ".join(RESERVED_IDS)))
        first.setdefault(robot.id, i)
        for axis in range(2):
            low, high = mission.area.min[axis], mission.area.max[axis]
            if low < high and not low <= robot.start[axis] <= high:
                allowed = f"a number from {low:g} to {high:g}, inside the area"
                problems.append(Problem(f"robots[{i}].start[{axis}]", show(robot.start[axis]), allowed))
    return problems


def _map(mission: Mission) -> list[Problem]:
    problem = None if mission.map is None else _check_kind("map.kind", "maps", mission.map.kind)
    return [] if problem is None else [problem]


def _link(mission: Mission) -> list[Problem]:
    link = mission.link
    problem = _check_kind("link.kind", "transports", link.kind)
    problems = [] if problem is None else [problem]
    if link.topology == "router" and not link.endpoints:
        problems.append(
            Problem("link.endpoints", "[]", 'where the router is, such as ["tcp/192.0.2.1:7447"]')
        )
    if link.keys and link.topology == "mesh":
        allowed = "star or router, where a router holds everybody to the own name; or no link.keys"
        problems.append(Problem("link.topology", show(link.topology), allowed))
    for i, endpoint in enumerate(link.endpoints):
        where = f"link.endpoints[{i}]"
        if not _ENDPOINT.match(endpoint):
            problems.append(Problem(where, show(endpoint), "protocol/address, such as tcp/192.0.2.1:7447"))
        elif link.keys and not endpoint.startswith("tls/"):
            problems.append(Problem(where, show(endpoint), "tls/HOST:PORT, since there are link.keys"))
        elif not link.keys and endpoint.startswith("tls/"):
            problems.append(Problem(where, show(endpoint), "tcp/HOST:PORT, or link.keys to have TLS with"))
    return problems


def _statements(mission: Mission) -> list[Problem]:
    """Statements whose keys do not fit together, or that nobody listens to."""
    problems = []
    for i, table in enumerate(mission.statements):
        try:
            said(table)
        except ValueError as error:
            problems.append(Problem(f"statements[{i}]", f"wrong {error}"))
    if mission.statements and deaf(mission.filter):
        listening = [kind for kind in plugins.kinds("filters") if not deaf({"kind": kind})]
        allowed = f"a filter that takes soft observations: {', '.join(listening) or 'none is installed'}"
        problems.append(Problem("filter.kind", show(mission.filter.get("kind")), allowed))
    return problems


def _capabilities(mission: Mission) -> list[Problem]:
    """Kinds of tasks that are nearly spelt right: a robot would silently never do them."""
    asked = {need for table in mission.requests for need in table.needs}
    problems = []
    for i, robot in enumerate(mission.robots):
        for j, name in enumerate(robot.capabilities):
            near = nearest(name, TASK_KINDS)
            if near and near != name and name not in asked:
                allowed = f"one of {', '.join(TASK_KINDS)}, or what a request needs"
                problems.append(Problem(f"robots[{i}].capabilities[{j}]", show(name), allowed, near))
    return problems


def request_problems(mission: Mission, table: RequestTable, where: str) -> list[Problem]:
    """What is wrong with a request to this mission's team; `where` begins the keys' names."""
    problems = []
    area = mission.area
    if len(table.at) != len(area.min):
        problems.append(Problem(f"{where}at", show(table.at), f"{len(area.min)} values, as many as area.min"))
    for i, (x, low, high) in enumerate(zip(table.at, area.min, area.max, strict=False)):
        if low < high and not low <= x <= high:
            allowed = f"a number from {low:g} to {high:g}, inside the area"
            problems.append(Problem(f"{where}at[{i}]", show(x), allowed))
    able = [r.id for r in mission.robots if {"request", *table.needs} <= {*r.capabilities}]
    if len(able) < table.robots:
        found = f"{show(table.needs)}, which {', '.join(able) or 'no robot'} can do"
        allowed = f"capabilities that {table.robots} of the mission's robots have, with request"
        problems.append(Problem(f"{where}needs", found, allowed))
    if not shares_tasks(mission.planner):
        sharing = [kind for kind in plugins.kinds("planners") if shares_tasks({"kind": kind})]
        allowed = f"a planner whose robots share tasks, for requests: {', '.join(sharing)}"
        problems.append(Problem("planner.kind", show(mission.planner.get("kind")), allowed))
    return problems


def shares_tasks(table: Mapping[str, Any]) -> bool:
    """Whether the robots of a mission's planner, as far as it can be loaded, share tasks between them."""
    try:
        return hasattr(plugins.load("planners", str(table.get("kind"))), "desk")
    except (SearchpartyError, ImportError, AttributeError):
        return True  # which the table's own check reports


def deaf(table: Mapping[str, Any]) -> bool:
    """Whether a mission's filter, as far as it can be loaded, takes no soft observations."""
    try:
        return not hasattr(plugins.load("filters", str(table.get("kind"))), "observe")
    except (SearchpartyError, ImportError, AttributeError):
        return False  # which the table's own check reports
