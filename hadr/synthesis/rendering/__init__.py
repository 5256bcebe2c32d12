"""Pictures of a scene: cast rays, refraction, path tracing."""
