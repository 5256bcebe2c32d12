"""Pictures of the method: rays, voxels, features, hands, errors."""
