"""The swarm as a node of ROS 2, in the form of rmw_zenoh: no ROS and no bridge is needed here."""
