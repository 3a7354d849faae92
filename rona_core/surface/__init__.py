"""Surface point clouds, normals, ray casting and registration."""
