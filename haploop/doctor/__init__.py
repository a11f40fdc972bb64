"""`haploop doctor`: is the rig wired and set as its file says?"""
