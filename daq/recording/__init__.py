"""Recording a survey: the session, its folder on disk, its links and its handshake.

In: a survey file and open links. Out: logs in numbered rounds. Imported by head and service.
"""
