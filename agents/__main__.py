"""`python -m agents` is `searchparty`."""

from agents.cli import main

main()
