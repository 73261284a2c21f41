"""Recordings made ready: samples on a clock, smooth motion, stretches to replay.

Map: ``prepare`` splits recordings into fitted and held-out ones and reads their ``samples``;
``smooth`` makes a motion of them by ``curves``, beside what held commands do between samples
(``driven``), ``odometry`` the pose of a base that no sensor tells;
``stretches`` cuts out pieces to replay; ``grid`` finds measurements that come in steps.
"""
