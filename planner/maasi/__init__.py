"""The planners of (MA)ASI."""
