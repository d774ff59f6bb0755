"""``mocap-fit export``: face parameters for other programs."""
KINDS = ("gltf", "fap", "csv")
