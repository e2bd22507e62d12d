"""What people say to a running team, and what they hear back."""
