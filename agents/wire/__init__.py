"""What travels between the processes of a team, and how: messages, topics, codec, the transport seam."""
