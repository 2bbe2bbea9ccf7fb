"""The model: its state, the interfaces of its parts, pair laws, viscosity, shifting and tangents."""
