"""Evidence beside the joints' motion.

Map: ``forces`` compares measured actuator forces, ``sensors`` all further sensors, ``translation``
a trained translation of the same machine, with recordings as its ``observer`` sees them.
"""
