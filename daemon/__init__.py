"""The control daemon. The floors inside, each importing only what stands before it: messages and
files, host, robot, estimation, learning, reference, control, controllers, risk, supervision,
loop, recording, service, remote, workbench, commands.
"""
