"""What a body is: distances, rays, meshes, voxels."""
