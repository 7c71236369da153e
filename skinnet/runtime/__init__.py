"""Runtime of the logical processes: period loop, upstreams, worker, process results."""
