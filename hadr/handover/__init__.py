"""From restored depth to a handed-over object: grasps, scores, tracking, robot, workflow."""
