"""What planners are compared with: the baselines of (MA)ASI, and Thompson sampling."""
