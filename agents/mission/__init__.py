"""The mission: its tables, its file, and what makes one wrong."""
