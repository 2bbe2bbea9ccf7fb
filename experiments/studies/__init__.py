"""Studies, each of which answers a question about devices, waves or slopes."""
