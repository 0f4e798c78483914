"""The shapes of bodies: distances, rays, meshes, voxels."""
