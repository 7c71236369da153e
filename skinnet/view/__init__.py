"""Web page of a live or recorded run: body, skin, network, controller and processes in a browser."""
