"""Study: the same orders for many fleets, in parallel, and what more cars or another allocator are worth."""
