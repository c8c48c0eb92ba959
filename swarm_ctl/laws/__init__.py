"""Laws beside the paper's, each a module that keeps to `swarm_ctl.law` and can be read in a minute.
Their names are the modules'."""
