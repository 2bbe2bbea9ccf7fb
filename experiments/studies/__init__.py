"""Runs that answer a question about devices, waves or slopes."""
