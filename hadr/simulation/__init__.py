"""The handover in a physical simulation: world, robot, camera, attempts, films."""
