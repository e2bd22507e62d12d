"""One robot's part in settling between all robots who does what."""
