"""Surfaces: meshes, rays against them, sampled clouds and their normals."""
