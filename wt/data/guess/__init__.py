"""``wt import --guess``: a map of a log nobody has described, as it is believed, with its doubts.

``words``    what the name of a quantity says: its kind, its joint, its unit
``clock``    which quantity is time, and in which unit
``series``   what quantities without a telling name are, by how they move
``names``    joints and actuators of a model behind the log's names
``units``    units and signs, by the model's ranges and by what contradicts itself
``propose``  all of it, in order
``text``     the map as YAML with comments
"""
