"""A child process with a given behaviour, and a launcher of such children: BEHAVIOUR [FILE]."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from agents.process import lifeline
from agents.swarm.processes import Command, Restart
from agents.swarm.supervisor import Supervisor


def command(
    name: str, behaviour: str, *arguments: str, restart: Restart = "never", role: str = "robot"
) -> Command:
    argv = (sys.executable, "-m", "tests.agents.supervised_child", behaviour, *arguments)
    return Command(name, role, argv, restart)


def child(behaviour: str, *arguments: str) -> int:
    if behaviour == "exit":
        return int(arguments[0])
    if behaviour == "fail once":  # the file tells that it happened
        flag = Path(arguments[0])
        if not flag.exists():
            flag.touch()
            return 1
        return 0
    if behaviour == "environment":
        print(os.environ["OMP_NUM_THREADS"], os.environ["NUMBA_NUM_THREADS"], flush=True)
        print("an error line", file=sys.stderr)
        return 0
    held = lifeline.start()
    if behaviour == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if behaviour == "with grandchild":
        # It inherits all that may be inherited, and outlives us.
        with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(15)"], close_fds=False):
            print("ready", held, flush=True)
            signal.pause()
    print("ready", held, flush=True)
    while True:
        time.sleep(60)


async def launch(directory: Path) -> None:
    behaviours = ["plain", "stubborn", "with grandchild"]
    commands = [command(behaviour, behaviour) for behaviour in behaviours]
    async with Supervisor(commands, directory) as supervisor:
        while not all("ready True" in log.read_text() for log in directory.glob("*.log")):
            await asyncio.sleep(0.01)
        print(*(status.pid for status in supervisor.statuses()), flush=True)
        await supervisor.wait()


if __name__ == "__main__":
    if sys.argv[1] == "launch":
        asyncio.run(launch(Path(sys.argv[2])))
    else:
        sys.exit(child(*sys.argv[1:]))
