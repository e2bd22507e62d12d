"""The runtime: messages, topics, transport and clock seams, ledger, the Robot and Fusion state machines."""
