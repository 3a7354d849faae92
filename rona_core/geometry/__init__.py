"""Poses with covariance, frame graph, least-squares fits, robust statistics and the 5D path."""
