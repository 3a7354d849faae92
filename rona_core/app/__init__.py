"""What a session can do: messages, handlers, store, activities and jobs."""
