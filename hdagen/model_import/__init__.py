"""URDF and MJCF models as robot files: read by MuJoCo, reduced to one chain, written with the source of each number."""
