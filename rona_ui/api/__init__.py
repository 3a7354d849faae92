"""REST: routes made from the command list, queries, jobs, devices, event streams, problems."""
