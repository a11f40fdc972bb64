from .check_files import check_files as check_files
from .check_files import dated_check as dated_check
from .check_files import save_check as save_check
from .new_files import check_destination as check_destination
from .new_files import check_new_file as check_new_file
from .new_files import check_new_picture as check_new_picture
from .new_files import new_file as new_file
from .pictures import save_picture as save_picture
